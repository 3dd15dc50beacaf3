"""What the services of the firmware take at most: the word between the machine code and the native program."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ServiceBounds:
    """The most cycles that the services can take, from their code: of execution, without what interrupts them.

    A transmission of n bytes takes the UART's service ``uart`` + n ``uart_byte``.
    """

    tick: int
    adc: int
    uart: int
    uart_byte: int
