"""A run as a value-change dump (IEEE 1364 VCD), which waveform viewers open. The only file that knows pyvcd."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Final, Self, TextIO

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.interrupts import INT0, INT1, SOURCES
from firmware_sim.board.waveform import AT_POWER_UP, BUSY, LINES, REQUESTS, SERVICES, TX, TX_BYTE
from firmware_sim.errors import UsageError

try:
    from vcd import VCDWriter
except ImportError:
    raise UsageError("--vcd needs pyvcd, which is not installed: pip install 'firmware-sim[vcd]'") from None

_NS_PER_S: Final = 10**9
_PS_PER_S: Final = 10**12
_ROOT: Final = "board"


class ValueChanges:
    """The dump of one run, written to ``file``; leave it as a context, so that it is complete.

    The unit of time is 1 ns where a cycle is a whole number of them (40 ns on the default board), else 1 ps, and a
    cycle then begins in the picosecond in which it truly begins.
    """

    def __init__(self, file: TextIO, h1_hz: int) -> None:
        self._h1_hz = h1_hz
        self._units_per_s = _PS_PER_S if _NS_PER_S % h1_hz else _NS_PER_S
        timescale = "1 ps" if _NS_PER_S % h1_hz else "1 ns"
        # The same run gives the same bytes: no date.
        self._writer = VCDWriter(file, timescale=timescale, date="", version="firmware-sim")
        self._variables: dict[int, Any] = {}
        for source in SOURCES:
            self._add(REQUESTS + source.bit, "requests", source.name)
            self._add(SERVICES + source.bit, "services", source.name)
        for line, name in ((INT0, "INT0"), (INT1, "INT1")):
            self._add(LINES + line, "lines", name)
        self._add(BUSY, "processor", "busy")
        self._add(TX, "uart", "TX")
        self._variables[TX_BYTE] = self._writer.register_var(f"{_ROOT}.uart", "byte", "wire", size=8, init="x")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()

    def add(self, changes: NDArray[np.int64]) -> None:
        """Changes (n, 3) as ``Waveform`` has them, not earlier than those added before."""
        writer, variables, units, h1_hz = self._writer, self._variables, self._units_per_s, self._h1_hz
        for cycle, signal, value in changes.tolist():
            writer.change(variables[signal], cycle * units // h1_hz, value)

    def end(self, cycle: int) -> None:
        """Nothing changes any more until ``cycle``, where the run ends."""
        self._writer.flush(cycle * self._units_per_s // self._h1_hz)

    def _add(self, signal: int, scope: str, name: str) -> None:
        level = AT_POWER_UP >> signal & 1
        self._variables[signal] = self._writer.register_var(f"{_ROOT}.{scope}", name, "wire", size=1, init=level)
