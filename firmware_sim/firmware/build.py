"""The board's own firmware: kernels and assembly services become one image (docs/firmware.md).

``build_firmware(sheet)`` gives the image for a board; what differs from board to board (rates, scales, the initial
position) is in its parameters and constants, the services and kernels are the same.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from firmware_sim.board import adc, timer
from firmware_sim.board.bus import DEVICES, MEMORY
from firmware_sim.board.interrupts import BITS
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.c3x import floats
from firmware_sim.c3x.bounds import Bounds
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.aligning import AlignmentPlan
from firmware_sim.firmware.bounds import ServiceBounds
from firmware_sim.firmware.calibration import CALIBRATION_WORDS, calibration_words
from firmware_sim.firmware.chosen import navigator_of
from firmware_sim.firmware.spectrum import (
    FFT_SECTION,
    SpectrumPlan,
    check_background,
    fft_tables,
    rate_scale,
    spectrum_constants,
    spectrum_loops,
)
from firmware_sim.firmware.start import Start, interleaved, two_words
from firmware_sim.firmware.transmit_account import FRACTION_BITS, RING_SIZE, TransmitLimits
from firmware_sim.jit import remembered
from firmware_sim.kernels.expressions import ArrayType
from firmware_sim.kernels.language import Kernel, KernelError
from firmware_sim.kernels.lower_c3x import ON_CHIP, MachineProgram, compile_kernels
from firmware_sim.nav.start import accept_scale
from firmware_sim.toolchain.assembler import AssembledImage, assemble
from firmware_sim.toolchain.image import Symbol

ASSEMBLY: Final = Path(__file__).parent / "assembly"
FILES: Final = (
    "memory.asm",
    "vectors.asm",
    "boot.asm",
    "adc.asm",
    "uart.asm",
    "events.asm",
    "tick.asm",
    "frame.asm",
    "commands.asm",
)
SPECTRUM_FILES: Final = ("spectrum.asm", "fft.asm")
"""Of a board with spectra."""
SERVICES: Final = {"adc_service": "INT0", "uart_service": "INT1", "tick_service": "TINT0"}

_VECTOR_PAGE: Final = 1
# Counts of a timer (two cycles) from reset to the start of the stopwatch, and from its reading to the setting of the
# tick's counter, as boot.asm stands: the first tick comes 20 ms behind reset (tests/firmware/test_firmware.py).
_FROM_RESET: Final = 4
_FROM_RESET_TO_TICK: Final = 5
# Counts of the stopwatch by which a tick must be late before the background starves the watchdog.
_OVERDUE: Final = 10_000
# A ring stands at a multiple of twice its length: circular addressing wants K zeros, 2^K above the length (SPRU031,
# chapter 6); with one less the pointer moves into the ring below.
_SECTIONS: Final = {
    "reset": 0x0000,
    "vectors": _VECTOR_PAGE << 8,
    "boot": 0x0200,
    "services": 0x0400,
    "kernels": 0x0C00,
    "constants": 0x5800,
    "tables": 0x6000,
    "command": 0x7E00,
    "tx_ring": 0x10000,
    "rx_ring": 0x14000,
}
# The transform's bit-reversed pointer needs a multiple of its points.
_SPECTRUM_SECTIONS: Final = {"spectrum": 0x7F10, FFT_SECTION: 0x8000, "pieces": 0x8800, "samples": 0x12000}


# How often the loops of the assembly run whose counts are not in the code; what happens only in a cycle that is late
# counts once: one tick was missed, one byte of a command comes with one transmission.
_LIMITS: Final = {"whole_more": 2, "uart_next": 3, "adc_channel": 6, "scale_word": 6}

_DEVICE_POINTERS: Final = ("adc_at", "uart_at", "timer0_at", "timer1_at", "watchdog_at")


@dataclass(frozen=True)
class Firmware:
    """The image, the kernels in it and the assembly that it was made of."""

    image: AssembledImage
    kernels: MachineProgram
    source: str
    longest_description: int
    spectrum: SpectrumPlan | None

    def address(self, symbol: str) -> int:
        """The address of a label or of a variable."""
        return self.image.symbols[symbol].value

    def bounds(
        self, transmitted: int = 16, uart_passes: int = _LIMITS["uart_next"], without: Collection[str] = ()
    ) -> Bounds:
        """Bounds of the code, when a service transmits at most so many bytes at a time and asks the UART so often, and
        the places named in ``without`` are not reached."""
        words: dict[int, int] = {}
        for section in self.image.sections.values():
            words |= dict(enumerate(section.words, section.address))
        limits = {
            **self.kernels.loops,
            **_LIMITS,
            "uart_next": uart_passes,
            "uart_last": transmitted,
            "describe_byte": self.longest_description,
            "send_word": telemetry.NAVIGATION_WORDS,
            "notify_word": 2,
            **(spectrum_loops(self.spectrum) if self.spectrum else {}),
        }
        return Bounds(
            lambda address: words[address],
            {self.address(name): trips for name, trips in limits.items()},
            without={self.address(name) for name in without},
            slow={self.address(name) & 0xFFFF for name in _DEVICE_POINTERS},
        )

    @functools.cached_property
    def axis_bound(self) -> int:
        """What the background takes at most for the spectrum of one axis, of execution."""
        return self.bounds().of(self.address("spectrum"))

    def with_bounds(self) -> Firmware:
        """The same, with its bounds worked out: so they are kept beside it."""
        assert self.service_bounds
        return self

    @functools.cached_property
    def service_bounds(self) -> ServiceBounds:
        """The bounds of a tick without a command, of a sample while its sum cannot overflow, of a transmission."""
        usual = self.bounds(without=("tick_obeys", "adc_bounded"))
        tick, adc = (usual.of(self.address(name)) for name in ("tick_service", "adc_service"))
        one, full = (self.bounds(count, 2).of(self.address("uart_service")) for count in (1, 16))
        byte = (full - one) // 15
        return ServiceBounds(tick, adc, one - byte, byte)

    @property
    def words(self) -> int:
        """Code and data: the words that the image fills, and the room that it reserves."""
        return sum(section.size for section in self.image.sections.values())


def build_firmware(sheet: BoardSheet, start: Start | None = None, extra: Kernel | None = None) -> Firmware:
    """Build the firmware for a board; without a ``start`` it waits for one from the host.

    ``extra`` is a kernel of the user's that the tick calls behind the solver, with the solver's arrays that it names as
    its parameters, and no others.

    Raises KernelError or UsageError for kernels that cannot be compiled.
    """
    if extra is not None:
        _check_extra(extra, _roots(sheet))
        return _build(sheet, start, extra)
    key = f"{ASSEMBLY} {sheet} {start} {_assembly_text()}"  # the folder: a firmware knows its lines by their files
    firmware: Firmware = remembered("firmware", key, __file__, lambda: _build(sheet, start, None).with_bounds())
    return firmware


def service_bounds(sheet: BoardSheet) -> ServiceBounds:
    """The bounds of a board's services, kept from one run to the next."""
    bounds: ServiceBounds = remembered(
        "bounds", f"{sheet} {_assembly_text()}", __file__, lambda: build_firmware(sheet).service_bounds
    )
    return bounds


def _assembly_text() -> str:
    return "".join((ASSEMBLY / name).read_text(encoding="utf-8") for name in (*FILES, *SPECTRUM_FILES))


def _build(sheet: BoardSheet, start: Start | None, extra: Kernel | None) -> Firmware:
    roots = _roots(sheet)
    kernels = compile_kernels(roots if extra is None else (*roots, extra))
    hook = _extra_macro("" if extra is None else kernels.labels[extra.typed.name])
    plan = SpectrumPlan.of(sheet)
    files = FILES if plan is None else (*FILES, *SPECTRUM_FILES)
    parts = [*_definitions(sheet, kernels), *hook, kernels.source, *_includes(files), *_tables(sheet, start)]
    addresses = {**_SECTIONS, "onchip": ON_CHIP + kernels.words_on_chip}
    if plan is not None:
        addresses |= _SPECTRUM_SECTIONS
        parts += fft_tables(plan.points, rate_scale(sheet, plan.points))
    source = "\n".join(parts) + "\n"
    image = assemble(source, name="firmware", addresses=addresses, include_folders=[ASSEMBLY])
    firmware = Firmware(image, kernels, source, max(map(len, telemetry.descriptions(sheet))), plan)
    if plan is not None:
        check_background(sheet, plan, firmware.axis_bound, firmware.service_bounds)
    return firmware


def _roots(sheet: BoardSheet) -> tuple[Kernel, ...]:
    """The kernels that the assembly calls."""
    chosen = navigator_of(sheet)
    aligning = (chosen.begin_alignment, chosen.align) if AlignmentPlan.of(sheet) else ()
    return chosen.navigate, chosen.initialise, chosen.start, accept_scale, *aligning


def _check_extra(extra: Kernel, roots: tuple[Kernel, ...]) -> None:
    """An extra kernel works on arrays of the solver alone. Raises KernelError."""
    known = {name: kind for kernel in roots for name, kind in kernel.typed.parameters}
    typed = extra.typed
    for name, kind in typed.parameters:
        if not isinstance(kind, ArrayType) or known.get(name) != kind:
            arrays = ", ".join(f"{name}: {kind}" for name, kind in known.items() if isinstance(kind, ArrayType))
            raise KernelError(
                typed.file, typed.line, typed.name, f"expected arrays of the solver ({arrays}), found {name}: {kind}"
            )
    if typed.results:
        raise KernelError(typed.file, typed.line, typed.name, "expected a kernel without a result beside the solver")


def _extra_macro(label: str) -> list[str]:
    """What the tick does behind the solver."""
    return ["EXTRA       .macro", *([f"            CALL    {label}"] if label else []), "            .endm"]


def _includes(files: Sequence[str]) -> list[str]:
    return [f'            .include "{name}"' for name in files]


def _definitions(sheet: BoardSheet, kernels: MachineProgram) -> Iterator[str]:
    """The constants that the assembly files are written with."""
    devices = {window.name: window.first for window in DEVICES}
    on_chip = next(window for window in MEMORY if window.name == "on-chip RAM")
    table = telemetry.navigation_table(sheet)
    schedule = telemetry.DescriptionSchedule.of(sheet)
    limits = TransmitLimits.of(sheet)
    first_part = max(1, round(sheet.samples_per_tick / 2))
    plan = AlignmentPlan.of(sheet)
    spectrum = SpectrumPlan.of(sheet)
    values = {
        "ONCHIP": on_chip.first,
        "DATA_PAGE": on_chip.first >> 16,
        "KERNEL_CONSTANTS": kernels.constants,
        "KERNEL_CONSTANTS_AT": kernels.constants_at,
        "ADC": devices["A/D front end"],
        "UART": devices["UART"],
        "TIMER0": devices["timer 0"],
        "TIMER1": devices["timer 1"],
        "WATCHDOG": devices["watchdog"],
        "STROBES": devices["strobe control"],
        "IOSTRB": 0x48,  # two wait states, by the chip's own counter
        "VECTOR_PAGE": _VECTOR_PAGE,
        "TIMER_RUNS": timer.FUNC | timer.GO | timer.HLD | timer.CLKSRC,
        "FROM_RESET": _FROM_RESET,
        "FROM_RESET_TO_TICK": _FROM_RESET_TO_TICK,
        "SOURCES": sum(1 << BITS[name] for name in ("INT0", "INT1", "INT2", "INT3", "TINT0", "TINT1")),
        "TICK_SOURCE": 1 << BITS["TINT0"],
        "RUNNING": 0x6800,  # ST: edge triggered, GIE, cache
        "RING": RING_SIZE,
        "FRACTION_BITS": FRACTION_BITS,
        "MOST_WAITING": limits.most,
        "DRAINED": limits.drained,
        "PERIOD": sheet.timer_period,
        "DIVISOR": sheet.uart_divisor,
        "FIRST_PART": first_part,
        "SAFE_COUNT": first_part + (2**30 >> (sheet.adc.bits - 1)) - 1,
        "WATCHES": int(sheet.is_watched_in_background),
        "OVERDUE": _OVERDUE,
        "ALIGNS": int(plan is not None),
        "ALIGN_HALF": plan.half if plan else 0,
        "ALIGN_COARSE": plan.coarse if plan else 0,
        "ALIGN_END": plan.end if plan else 0,
        "ALIGN_UPDATE": plan.update if plan else 0,
        "ALIGN_VARIANCE": _single(plan.variance if plan else 0.0),
        "CALIBRATION": CALIBRATION_WORDS,
        "COARSE": telemetry.COARSE,
        "MOST": 2**30 - 1,
        "LEAST": -(2**30),
        "SATURATED": adc.SATURATED,
        "FAULTS": 0x3F << adc.FIRST_FAULT_BIT | adc.HEIGHT_FAULT,
        "NAVIGATE": telemetry.NAVIGATE,
        "NAVIGATION_TYPE": telemetry.NAVIGATION,
        "ANSWER_TYPE": telemetry.ANSWER,
        "EVENT_TYPE": telemetry.EVENT,
        "FRAME_WORDS": telemetry.NAVIGATION_WORDS,
        "DESCRIPTIONS": schedule.descriptions,
        "DESCRIBE_TICKS": schedule.ticks,
        "LATE_TICKS": schedule.late_ticks,
        "SPARE_BYTES": schedule.spare_bytes,
        "MOST_CREDIT": telemetry.MOST_CREDIT,
        "START_COMMAND": telemetry.START_COMMAND,
        "MODE_COMMAND": telemetry.MODE_COMMAND,
        "SCALE_COMMAND": telemetry.SCALE_COMMAND,
        "UNKNOWN_COMMAND": telemetry.UNKNOWN_COMMAND,
        "WRONG_LENGTH": telemetry.WRONG_LENGTH,
        "SPECTRUM": int(spectrum is not None),
        **(spectrum_constants(spectrum) if spectrum else {}),
        **{f"{name}_FLAG": value for name, value in _flags().items()},
        **{f"{name}_WORD": table.offset_of(field) // 4 for name, field in _WORDS.items()},
    }
    for name, value in values.items():
        yield f"{name:<24}.set    {value}"
    chosen = navigator_of(sheet)
    for name, kernel in (("SOLVE", chosen.navigate), ("INITIALISE", chosen.initialise), ("START", chosen.start)):
        yield f"            .asg    {kernels.labels[kernel.typed.name]},{name}"


_WORDS: Final = {
    "VALID": "valid_time",
    "TICK": "tick",
    "DEADLINE": "deadline",
    "FLAGS": "mode",
    "SOLVER": "solver_cycles",
    "ATTITUDE": "pitch",
    "VELOCITY": "vel_east",
    "LATITUDE": "latitude",
    "LONGITUDE": "longitude",
    "HEIGHT": "height",
    "SUMS": "gyro_sum_x",
    "OVERRUNS": "overruns",
    "LOST": "lost_samples",
}


def _flags() -> dict[str, int]:
    return {
        "LOST": telemetry.SAMPLE_LOST,
        "OVERRUN": telemetry.TICK_OVERRUN,
        "SATURATED": telemetry.SATURATED,
        "FAULT": telemetry.CHANNEL_FAULT,
        "DROPPED": telemetry.FRAME_DROPPED,
        "EMPTY": telemetry.NO_SAMPLES,
        "POWER": telemetry.POWER_FAILS,
        "WATCHDOG": telemetry.WATCHDOG_HAS_BITTEN,
    }


def _tables(sheet: BoardSheet, start: Start | None) -> Iterator[str]:
    """Parameters in page 0, where boot reads them, and the tables."""
    yield '            .sect   "boot"'
    yield f"start_is_known: .word {int(start is not None)}"
    yield "start_words:"
    for value in _start_values(start) if start else [0.0] * 13:
        yield _single_text(value)
    yield "scale_words:"
    for value in interleaved(list(sheet.adc.scale)):
        yield _single_text(value)
    yield "unit_words:"
    for value in calibration_words(sheet):
        yield _single_text(value)
    yield '            .sect   "tables"'
    yield "crc_table:"
    for byte in range(256):
        # The register after one byte: zlib inverts it before and behind.
        yield f"            .word   0{zlib.crc32(bytes([byte]), 0xFFFFFFFF) ^ 0xFFFFFFFF:08X}h"
    yield "descriptions:"
    for frame in telemetry.descriptions(sheet):
        yield f"            .word   {len(frame)}"
        for at in range(0, len(frame), 16):
            yield f"            .byte   {', '.join(str(byte) for byte in frame[at : at + 16])}"
    yield "            .word   0"


def _start_values(start: Start) -> list[float]:
    angles, angles_low = two_words([start.pitch_rad, start.roll_rad, start.azimuth_rad])
    return [*interleaved([start.lat_rad, start.lon_rad]), *start.vel_t_mps, *angles, *angles_low]


def _single(value: float) -> int:
    """The word of a single."""
    return int(floats.from_float64(value)) >> 8 & 0xFFFFFFFF


def _single_text(value: float) -> str:
    return f"            .word   0{_single(value):08X}h       ; {value!r}"


def map_of(firmware: Firmware) -> str:
    """What lies where: the sections, then every label and variable in the order of their addresses."""
    sections = sorted(firmware.image.sections.values(), key=lambda section: section.address)
    lines = [f"{firmware.words} words in all", "", "address  words  section"]
    lines += [f"{section.address:06X}  {section.size:>6}  {section.name}" for section in sections]
    lines += ["", "address  symbol"]
    symbols = [symbol for symbol in firmware.image.symbols.values() if _is_placed(symbol)]
    lines += [f"{symbol.value:06X}   {symbol.name}" for symbol in sorted(symbols, key=lambda s: (s.value, s.name))]
    return "\n".join(lines) + "\n"


def _is_placed(symbol: Symbol) -> bool:
    """Whether a symbol is an address and not a number: a label, or a variable of the kernels, which are on chip."""
    on_chip = next(window for window in MEMORY if window.name == "on-chip RAM")
    return symbol.section is not None or on_chip.first <= symbol.value <= on_chip.last
