"""How much may wait for the line: an account in whole numbers that every engine counts alike.

How full the transmit ring is when a frame comes depends on when the UART was served, cycle by cycle, which differs from
engine to engine. So no engine looks: each counts what it gave and what the line must have taken meanwhile.

**Why what it admits fits.** While bytes wait, the UART's service moves 16 of them to the FIFO each time that it is
empty: after the time of 16 bytes, or of 15, a start bit and the delay of the service, where that is longer; call it T.
So in a time w the ring loses more than 16 w/T - 16 bytes. The account takes off ``drained`` <= 16 P/T in each tick of
period P. Of n services of the tick the first may be a tick late and the last one early: they span (n - 2) P at least.
So the ring never holds more than the account says and 2 ``drained`` + 16 bytes; its last place stays free.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import floor
from typing import Final

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.uart import FIFO_SIZE

RING_SIZE: Final = 4096
"""Bytes of a ring, one in a word; a power of two, at a multiple of itself."""
FRACTION_BITS: Final = 16
"""The account counts in 2^-16 bytes: the line loses less than that in a tick."""
SERVICE_DELAY_CYCLES: Final = 900
"""From an empty FIFO to a full one at most: what has interrupts off, samples, the service (tests/firmware)."""
# More than the frames of one tick, so that no line that carries them is held back; the ring keeps room for them.
_MOST_DRAINED: Final = 1024


@dataclass(frozen=True)
class TransmitLimits:
    """What the line takes from the account in each tick, and the most that may wait, both in 2^-16 bytes."""

    drained: int
    most: int

    @classmethod
    def of(cls, sheet: BoardSheet) -> TransmitLimits:
        """For the line and the tick of a board."""
        byte = Fraction(10 * 16 * sheet.uart_divisor * sheet.h1_hz, sheet.uart.crystal_hz)
        fill = max(FIFO_SIZE * byte, (FIFO_SIZE - 1) * byte + byte / 10 + SERVICE_DELAY_CYCLES)
        carried = min(Fraction(FIFO_SIZE * sheet.tick_cycles) / fill, Fraction(_MOST_DRAINED))
        drained = floor(carried * 2**FRACTION_BITS)
        return cls(drained, (RING_SIZE - 1 - FIFO_SIZE << FRACTION_BITS) - 2 * drained)


class TransmitAccount:
    """Counts what waits under some ``TransmitLimits``, as tick.asm and frame.asm do."""

    def __init__(self, limits: TransmitLimits) -> None:
        self._limits = limits
        self._waiting = 0

    def tick(self) -> None:
        """Another tick has come."""
        self._waiting = max(0, self._waiting - self._limits.drained)

    def would_wait(self, size: int) -> int:
        """What would wait with ``size`` more bytes, in 2^-16 bytes."""
        return self._waiting + (size << FRACTION_BITS)

    def admits(self, size: int) -> bool:
        """Whether ``size`` bytes may go to the ring; they are counted then."""
        waiting = self.would_wait(size)
        if waiting > self._limits.most:
            return False
        self._waiting = waiting
        return True
