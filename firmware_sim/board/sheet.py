"""The board sheet: what a TOML file may set, and the frozen tree of values that the board is built from.

The dataclasses are the table of keys: each field carries its default, range, unit and meaning, and
validation, ``KEYS`` and the manual page all read them there.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from firmware_sim.board.clock import Oscillator, cycles_of, exact
from firmware_sim.board.sheet_checks import CHECKS, LONGEST_UNFED_S, WORD_MAX
from firmware_sim.errors import UsageError
from firmware_sim.toml_file import in_words, read_toml

STANDARD_GRAVITY_MPS2 = 9.80665
_MAX_BITS = 30
"""Three samples of 2^29, the fewest that a tick must have room for, stay below 2^31; those of 31 bits do not."""


class Key(NamedTuple):
    """One key of the board file. ``allowed`` is a pair (low, high), or the words that may stand there."""

    section: str
    name: str
    kind: type
    allowed: tuple[Any, ...]
    unit: str
    default: Any
    meaning: str


def _key(default: Any, allowed: tuple[Any, ...], unit: str, meaning: str) -> Any:
    return field(default=default, metadata={"allowed": allowed, "unit": unit, "meaning": meaning})


@dataclass(frozen=True)
class ProcessorSheet:
    """[processor]"""

    clkin_hz: int = _key(50_000_000, (2_000_000, 60_000_000), "Hz", "clock input, even; H1 is half of it")


@dataclass(frozen=True)
class TickSheet:
    """[tick]"""

    period_s: float = _key(0.02, (0.0005, 10.0), "s", "period of the navigation tick, a whole number of timer counts")


@dataclass(frozen=True)
class AdcSheet:
    """[adc], and the weight of one count.

    Neither kind samples at an instant: a count is the mean over the sample period, as an increment. *integrating*
    (sigma-delta) carries what a count could not show into the next one, *sampling* rounds each alone.
    ``lsb_override`` (gyro [rad], accelerometer [m/s]) is no key of the file: a recording of counts brings it.
    """

    rate_hz: float = _key(1000.0, (1.0, 100_000.0), "Hz", "nominal samples per second")
    offset_ppm: float = _key(0.0, (-10_000.0, 10_000.0), "ppm", "how much faster than nominal the A/D oscillator runs")
    kind: str = _key(
        "integrating",
        ("integrating", "sampling"),
        "",
        "the mean of a sample period: rest carried over, or rounded alone",
    )
    bits: int = _key(24, (8, _MAX_BITS), "bit", "resolution, sign included")
    gyro_range_degps: float = _key(200.0, (0.001, 100_000.0), "deg/s", "full scale of the gyros, plus and minus")
    acc_range_g: float = _key(5.0, (0.001, 100_000.0), "9.80665 m/s2", "full scale of the accelerometers")
    conversion_s: float = _key(10e-6, (0.0, 1.0), "s", "from the sampling instant to the end of conversion")
    lsb_override: tuple[float, float] | None = None

    @property
    def period_s(self) -> float:
        """Nominal sample period [s]: what firmware takes a sample to last."""
        return 1.0 / self.rate_hz

    @property
    def gyro_lsb_rad(self) -> float:
        """Weight of one gyro count [rad], as an increment over a nominal sample period."""
        if self.lsb_override:
            return self.lsb_override[0]
        return math.radians(self.gyro_range_degps) / 2 ** (self.bits - 1) / self.rate_hz

    @property
    def acc_lsb_mps(self) -> float:
        """Weight of one accelerometer count [m/s], as an increment over a nominal sample period."""
        if self.lsb_override:
            return self.lsb_override[1]
        return self.acc_range_g * STANDARD_GRAVITY_MPS2 / 2 ** (self.bits - 1) / self.rate_hz

    @property
    def scale(self) -> tuple[float, float, float]:
        """The weights of a count [rad] and [m/s], and the sample period [s]: what the solver is told."""
        return self.gyro_lsb_rad, self.acc_lsb_mps, self.period_s

    @property
    def gyro_full_scale(self) -> int:
        """Counts at which a gyro saturates: its range, in ``bits`` at most."""
        return self._full_scale(math.radians(self.gyro_range_degps), self.gyro_lsb_rad)

    @property
    def acc_full_scale(self) -> int:
        """Counts at which an accelerometer saturates: its range, in ``bits`` at most."""
        return self._full_scale(self.acc_range_g * STANDARD_GRAVITY_MPS2, self.acc_lsb_mps)

    def _full_scale(self, full_range: float, lsb: float) -> int:
        return math.ceil(min(2 ** (self.bits - 1), full_range / self.rate_hz / lsb))


@dataclass(frozen=True)
class UartSheet:
    """[uart]"""

    crystal_hz: int = _key(1_843_200, (100_000, 16_000_000), "Hz", "crystal of the 16C550")
    baud: int = _key(115_200, (50, 1_000_000), "baud", "line rate; a divisor must reach it within 2 %")


@dataclass(frozen=True)
class AlignmentSheet:
    """[alignment]"""

    settling_s: float = _key(
        0.0, (0.0, 7200.0), "s", "from the start to navigation; 0: the attitude is given and nothing is aligned"
    )
    coarse_s: float = _key(60.0, (10.0, 600.0), "s", "length of the coarse stage")
    velocity_noise_mps: float = _key(
        0.01, (0.001, 10.0), "m/s", "one sigma of the true velocity of a unit that does not travel"
    )


def _triad(most: float, unit: str, meaning: str, count: int = 3) -> Any:
    return _key((0.0,) * count, (-most, most), unit, meaning)


@dataclass(frozen=True)
class CalibrationSheet:
    """[calibration]: errors that are known of the unit, which the firmware takes out of what the sensors report."""

    gyro_bias_degph: tuple[float, ...] = _triad(1e5, "deg/h", "of x, y, z: reported at rest in inertial space")
    gyro_scale_ppm: tuple[float, ...] = _triad(1e5, "ppm", "of x, y, z: reported too much of a rate")
    gyro_misalignment_arcsec: tuple[float, ...] = _triad(
        1e5, "arcsec", "x of y, x of z, y of x, y of z, z of x, z of y: reported by one of a rate about the other", 6
    )
    acc_bias_ug: tuple[float, ...] = _triad(1e6, "9.80665 um/s2", "as of the gyros, in free fall")
    acc_scale_ppm: tuple[float, ...] = _triad(1e5, "ppm", "as of the gyros")
    acc_misalignment_arcsec: tuple[float, ...] = _triad(1e5, "arcsec", "as of the gyros", 6)


@dataclass(frozen=True)
class BudgetSheet:
    """[budget]"""

    nav_cycles: int | None = _key(
        None, (1, 600_000_000), "cycles", "execution allowed to the solver service; without it, the tick period"
    )


@dataclass(frozen=True)
class LineSheet:
    """[line]"""

    policy: str = _key("hold", ("hold", "drop", "wait"), "", "what becomes of bytes that nobody reads")
    linger_s: float = _key(10.0, (0.0, 3600.0), "s", "how long the end of a run waits for a reader, by the wall clock")


@dataclass(frozen=True)
class NavigationSheet:
    """[navigation]: which solver the firmware is built with."""

    mechanisation: str = _key(
        "wander", ("wander", "enu"), "", "navigation frame: wander azimuth, or local level east-north-up"
    )
    ellipsoid: str = _key("wgs84", ("wgs84", "krassovsky"), "", "the Earth of the solver")
    curvature: str = _key(
        "exact", ("exact", "first-order"), "", "its radii with height, or of first order in the flattening without"
    )
    gravity: str = _key("normal", ("normal", "original"), "", "of WGS-84, or the original formula of the mechanisation")
    vertical: str = _key(
        "external", ("external", "damped", "free"), "", "height from outside, integrated and held to it, or integrated"
    )


@dataclass(frozen=True)
class SpectrumSheet:
    """[spectrum]: of the gyros, about once a second."""

    points: int = _key(0, (0, 512), "samples", "length of the window: 256 or 512; 0: no spectra")


@dataclass(frozen=True)
class BoardSheet:
    """All values of a board. ``source`` names where they came from, for messages.

    Raises UsageError, naming source and key, when a value is of a wrong type or out of range, or when values
    do not fit together.
    """

    processor: ProcessorSheet = ProcessorSheet()
    tick: TickSheet = TickSheet()
    adc: AdcSheet = AdcSheet()
    uart: UartSheet = UartSheet()
    alignment: AlignmentSheet = AlignmentSheet()
    calibration: CalibrationSheet = CalibrationSheet()
    budget: BudgetSheet = BudgetSheet()
    line: LineSheet = LineSheet()
    navigation: NavigationSheet = NavigationSheet()
    spectrum: SpectrumSheet = SpectrumSheet()
    source: str = "the default board"

    def __post_init__(self) -> None:
        for key in KEYS:
            complaint = _complaint(key, getattr(getattr(self, key.section), key.name))
            if complaint:
                raise UsageError(f"{self.source}: {complaint}")
        for check in CHECKS:
            complaint = check(self)
            if complaint:
                raise UsageError(f"{self.source}: {complaint}")

    @property
    def h1_hz(self) -> int:
        """Cycles per second."""
        return self.processor.clkin_hz // 2

    @cached_property  # asked for in each tick
    def timer_period(self) -> int:
        """Period register of TIMER0 for the tick, in pulse mode (counts of H1/2)."""
        return round(exact(self.tick.period_s) * self.h1_hz / 2)

    @property
    def is_watched_in_background(self) -> bool:
        """Whether ticks come too seldom to feed the watchdog, with one that is missed."""
        return 2 * self.tick.period_s > LONGEST_UNFED_S

    @property
    def tick_cycles(self) -> int:
        """Cycles from tick to tick."""
        return 2 * self.timer_period

    @property
    def budget_cycles(self) -> int:
        """Cycles of execution that the solver service may take."""
        return self.budget.nav_cycles or self.tick_cycles

    @cached_property
    def sample_oscillator(self) -> Oscillator:
        """The A/D's own oscillator, offset included."""
        return Oscillator.from_period(self.h1_hz / self.true_rate_hz)

    @property
    def conversion_cycles(self) -> int:
        """Cycles from a sampling instant to the end of conversion."""
        return cycles_of(self.adc.conversion_s, self.h1_hz)

    @property
    def samples_per_tick(self) -> Fraction:
        """Samples that the A/D makes in one tick, on average."""
        return exact(self.tick.period_s) * self.true_rate_hz

    @property
    def true_rate_hz(self) -> Fraction:
        return exact(self.adc.rate_hz) * (1 + exact(self.adc.offset_ppm) / 1_000_000)

    @property
    def uart_divisor(self) -> int:
        """Divisor latch of the UART for the line rate of the sheet."""
        return max(1, round(Fraction(self.uart.crystal_hz, 16 * self.uart.baud)))

    def with_adc(self, *, rate_hz: float, lsb: tuple[float, float] | None = None) -> BoardSheet:
        """The same board with the A/D of a recording: its rate [Hz] and, for counts, the weights [rad, m/s] of one.

        A recording's samples have no oscillator of their own, so the offset is zero. Counts were made elsewhere:
        they pass at the widest resolution that the sums have room for. The ranges hold for every recording.

        Raises UsageError when such samples do not fit the tick.
        """
        adc = dataclasses.replace(self.adc, rate_hz=rate_hz, offset_ppm=0.0, lsb_override=lsb)
        if lsb is not None:
            samples = math.ceil(exact(self.tick.period_s) * exact(rate_hz)) + 1
            adc = dataclasses.replace(adc, bits=min(_MAX_BITS, (WORD_MAX // samples).bit_length()))
        return dataclasses.replace(self, adc=adc)


_SECTIONS: dict[str, Any] = {
    entry.name: type(entry.default)
    for entry in dataclasses.fields(BoardSheet)
    if dataclasses.is_dataclass(entry.default)
}
_KINDS = {"int": int, "float": float, "str": str, "int | None": int, "tuple[float, ...]": tuple}


def _keys() -> Iterator[Key]:
    for section, sheet_class in _SECTIONS.items():
        for entry in dataclasses.fields(sheet_class):
            if entry.metadata:
                kind = _KINDS[str(entry.type)]
                yield Key(section, entry.name, kind, default=entry.default, **entry.metadata)


KEYS = tuple(_keys())
"""Every key of a board file, in the order of the file."""


def load_sheet(path: Path | str | None = None) -> BoardSheet:
    """Read and check a board file; the defaults of the board when ``path`` is None.

    Raises UsageError, naming file and key, for a file that cannot be read, an unknown key, a wrong type, a
    value out of range, and values that do not fit together.
    """
    if path is None:
        return BoardSheet()
    source = str(path)
    table = read_toml(path, "board file")
    sections = {name: _section(source, name, entries) for name, entries in table.items()}
    return BoardSheet(**sections, source=source)


def _section(source: str, name: str, entries: Any) -> Any:
    if name not in _SECTIONS:
        raise UsageError(f"{source}: expected the sections {', '.join(_SECTIONS)}, found [{name}]")
    if not isinstance(entries, dict):
        raise UsageError(f"{source}: expected a section [{name}], found {name} = {in_words(entries)}")
    names = [key.name for key in KEYS if key.section == name]
    for entry in entries:
        if entry not in names:
            raise UsageError(f"{source}: [{name}]: expected the keys {', '.join(names)}, found {entry}")
    return _SECTIONS[name](
        **{entry: tuple(value) if isinstance(value, list) else value for entry, value in entries.items()}
    )


def _is_in(value: Any, key: Key) -> bool:
    """Whether a value is a number of the kind and range of ``key``."""
    kind = int if key.kind is int else (int, float)
    return isinstance(value, kind) and not isinstance(value, bool) and key.allowed[0] <= value <= key.allowed[1]


def _complaint(key: Key, value: Any) -> str:
    """What is wrong with ``value`` for ``key``, or nothing; a key without a default may stay None."""
    if value is None and key.default is None:
        return ""
    if key.kind is tuple:
        fits = (
            isinstance(value, tuple) and len(value) == len(key.default) and all(_is_in(number, key) for number in value)
        )
        expected = f"a list of {len(key.default)} numbers from {key.allowed[0]:g} to {key.allowed[1]:g} {key.unit}"
    elif key.kind is str:
        fits = value in key.allowed
        expected = " or ".join(f'"{word}"' for word in key.allowed)
    else:
        low, high = key.allowed
        fits = _is_in(value, key)
        expected = f"{'an integer' if key.kind is int else 'a number'} from {low} to {high} {key.unit}"
    return "" if fits else f"[{key.section}] {key.name}: expected {expected}, found {in_words(value)}"
