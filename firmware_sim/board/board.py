"""The circuit: devices wired to the interrupt lines, and the board that runs a processor on it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.adc import END_OF_CONVERSION, SAMPLE, adc_advance, adc_next, new_adc
from firmware_sim.board.clock import EventQueue
from firmware_sim.board.interrupts import INT0, INT1, TINT0, TINT1, new_interrupts, request, set_line
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.timer import new_timer, timer_advance, timer_next
from firmware_sim.board.uart import new_uart, uart_advance, uart_next, uart_receive
from firmware_sim.jit import jit

OUT_CAPACITY = 1 << 16
_OUT_RESERVE = 1 << 10
_SHORTEST_FRAME_BITS = 7


class Circuit(NamedTuple):
    """The arrays of all devices: one argument for compiled code.

    ``samples`` (n,) of SAMPLE is the loaded block, ``out`` (OUT_CAPACITY,) of uint8 what the UART has sent;
    every other array has shape (1,).
    """

    interrupts: NDArray[np.void]
    timer0: NDArray[np.void]
    timer1: NDArray[np.void]
    adc: NDArray[np.void]
    uart: NDArray[np.void]
    samples: NDArray[np.void]
    out: NDArray[np.uint8]


@jit
def _levels(circuit: Circuit) -> int:
    """INT0 and INT1 as the devices drive them now, bits 0 and 1."""
    return (circuit.adc[0].status & END_OF_CONVERSION) << INT0 | circuit.uart[0].irq << INT1


@jit
def _drive_lines(circuit: Circuit) -> None:
    levels = _levels(circuit)
    for bit in (INT0, INT1):
        if (levels ^ circuit.interrupts[0].lines) >> bit & 1:
            set_line(circuit.interrupts, bit, levels >> bit & 1)


@jit
def circuit_next(circuit: Circuit) -> int:
    """Cycle in which a device next needs ``circuit_advance``, or FAR_FUTURE.

    It is a cycle already past (0) after a register access that moved an interrupt line.
    """
    if circuit.uart[0].rose or _levels(circuit) != circuit.interrupts[0].lines & (1 << INT0 | 1 << INT1):
        return 0
    return min(
        min(adc_next(circuit.adc), uart_next(circuit.uart)),
        min(timer_next(circuit.timer0), timer_next(circuit.timer1)),
    )


@jit
def circuit_advance(circuit: Circuit, now: int) -> None:
    """Let every device do what it does up to and including cycle ``now``, and raise the requests.

    Requests of the same cycle all pend; ``next_source`` decides between them (INT0 before TINT0). A device's
    registers are to be accessed after this, with the same ``now``.
    """
    if adc_advance(circuit.adc, circuit.samples, now) > 0:
        request(circuit.interrupts, INT0)
    uart_advance(circuit.uart, circuit.out, now)
    if circuit.uart[0].rose:
        circuit.uart[0].rose = 0
        request(circuit.interrupts, INT1)
    if timer_advance(circuit.timer0, now) > 0:
        request(circuit.interrupts, TINT0)
    if timer_advance(circuit.timer1, now) > 0:
        request(circuit.interrupts, TINT1)
    _drive_lines(circuit)


class Processor(Protocol):
    """Any program on the board: machine code on a simulator, or a native one."""

    def run(self, circuit: Circuit, now: int, until: int) -> int:
        """Run from cycle ``now`` at least to ``until`` and return the cycle reached.

        It calls ``circuit_advance`` whenever time reaches ``circuit_next``, and ends with the circuit
        advanced to the cycle that it returns. What begins in that cycle, an interrupt service too, belongs to
        the next call: external events of the cycle are still to come. It may pass ``until`` by the length of
        what it cannot cut.
        """
        ...


class Board:
    """One board: a circuit built from a sheet, its time, and the bytes that it has sent.

    Boards share nothing, so several can run side by side.
    """

    def __init__(self, sheet: BoardSheet) -> None:
        self.sheet = sheet
        self.now = 0
        self.events = EventQueue()
        self.circuit = Circuit(
            interrupts=new_interrupts(),
            timer0=new_timer(),
            timer1=new_timer(),
            adc=new_adc(sheet),
            uart=new_uart(sheet),
            samples=np.zeros(0, SAMPLE),
            out=np.zeros(OUT_CAPACITY, np.uint8),
        )
        self._sent = bytearray()
        self._longest_slice = self._cycles_until_full(sheet)

    @staticmethod
    def _cycles_until_full(sheet: BoardSheet) -> int:
        """Cycles in which even the fastest setting of the UART cannot fill the out array."""
        shortest_frame = _SHORTEST_FRAME_BITS * 16 * sheet.h1_hz // sheet.uart.crystal_hz
        return (OUT_CAPACITY - _OUT_RESERVE) * shortest_frame

    def load_samples(self, samples: NDArray[np.void]) -> None:
        """Append a block of samples (n,) of SAMPLE to those that the A/D has not yet taken.

        Raises ValueError for another dtype, and when the A/D ran dry and the time of the block's first sample is past.
        """
        if samples.dtype != SAMPLE:
            raise ValueError(f"samples: expected dtype {SAMPLE}, found {samples.dtype}")
        adc = self.circuit.adc
        left = self.circuit.samples[int(adc["used"][0]) :]
        first_end = int(adc["instant"][0] + adc["conversion"][0])
        if len(left) == 0 and first_end < self.now:
            raise ValueError(
                f"samples: expected the block of sample {int(adc['number'][0]) + 1} before cycle {first_end},"
                f" found it loaded in cycle {self.now}"
            )
        block = np.concatenate([left, samples])
        adc["used"], adc["loaded"] = 0, len(block)
        self.circuit = self.circuit._replace(samples=block)

    @property
    def samples_until(self) -> int:
        """Cycle after which the A/D has no sample: the end of the last loaded conversion (0 when none was loaded)."""
        adc = self.circuit.adc[0]
        last = int(adc["number"] + adc["loaded"] - adc["used"])
        return self.sheet.sample_oscillator.event(last) + int(adc["conversion"]) if last else 0

    def request_at(self, cycle: int, bit: int) -> None:
        """Pulse interrupt line ``bit`` in ``cycle`` (INT2 for an external event, INT3 for a failing supply)."""
        self.events.push(cycle, lambda: request(self.circuit.interrupts, bit))

    def receive(self, data: bytes) -> int:
        """Bytes from the host begin to come in now; returns how many the line took."""
        for taken, byte in enumerate(data):
            if not uart_receive(self.circuit.uart, byte, self.now):
                return taken
        return len(data)

    def run(self, processor: Processor, until: int) -> int:
        """Run ``processor`` at least to cycle ``until``, with the events on the way; returns the cycle reached.

        The span is cut so that the out array cannot overflow.
        """
        self.events.fire(self.now)
        while self.now < until:
            horizon = min(until, self.events.next_cycle, self.now + self._longest_slice)
            self.now = int(processor.run(self.circuit, self.now, horizon))
            if self.now < horizon:
                raise RuntimeError(f"processor: expected to run to cycle {horizon}, found it stopped at {self.now}")
            self._collect_output()
            self.events.fire(self.now)
        return self.now

    def take_output(self) -> bytes:
        """The bytes whose last stop bit has ended since the call before."""
        self._collect_output()
        sent = bytes(self._sent)
        self._sent.clear()
        return sent

    def _collect_output(self) -> None:
        uart = self.circuit.uart
        if uart["out_lost"][0]:
            raise RuntimeError(f"out array: expected at most {OUT_CAPACITY} bytes in one run of the processor")
        self._sent += self.circuit.out[: int(uart["out_count"][0])].tobytes()
        uart["out_count"] = 0
