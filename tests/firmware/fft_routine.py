"""fft.asm on a processor of its own, and its kernel beside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.machine import Reason
from firmware_sim.firmware.build import ASSEMBLY
from firmware_sim.firmware.spectrum import FFT_SECTION, fft_constants, fft_tables
from firmware_sim.kernels.lower_numba import C3X
from firmware_sim.kernels.target import build_target
from firmware_sim.nav import fft
from firmware_sim.toolchain.assembler import assemble

RING, RING_WORDS, AMPLITUDES = 0x12000, 4096, 0x9000
STACK, RETURN_TO = 0x87FFE0, 0x000100
CACHE = 0x800
"""The bit of ST that enables the cache, as boot sets it."""


class Routine:
    """fft.asm of one size, on a processor of its own."""

    def __init__(self, points: int) -> None:
        self.points = points
        lines = [f"{name} .set {value}" for name, value in fft_constants(points).items()]
        lines += [(ASSEMBLY / "fft.asm").read_text(), *fft_tables(points, scale_of(points))]
        addresses = {"services": 0x0400, FFT_SECTION: 0x8000}
        self.image = assemble("\n".join(lines) + "\n", name="fft", addresses=addresses)
        self.cpu = Cpu()
        for section in self.image.sections.values():
            for address, word in enumerate(section.words, section.address):
                self.cpu.memory[address] = word
        self.cpu.add_breakpoint(RETURN_TO)

    def __call__(self, counts: NDArray[np.int64], first: int) -> tuple[list[int], list[int], int]:
        """Of counts that begin at sample ``first`` of the ring: words of the amplitudes and the data, and cycles."""
        cpu, data_at = self.cpu, self.image.symbols["fft_data"].value
        for number, count in enumerate(counts.tolist()):
            cpu.memory[RING + 4 * (first + number) % RING_WORDS] = count & 0xFFFFFFFF
        cpu.reg["AR0"], cpu.reg["AR6"], cpu.reg["BK"] = RING + 4 * first, AMPLITUDES, RING_WORDS
        cpu.reg["SP"], cpu.memory[STACK] = STACK, RETURN_TO
        cpu.st, cpu.pc, before = CACHE, self.image.symbols["fft"].value, cpu.cycles
        assert cpu.run(1_000_000) is Reason.BREAKPOINT
        assert (cpu.reg["SP"], cpu.reg["BK"]) == (STACK - 1, RING_WORDS)
        return self._words(AMPLITUDES, self.points // 2), self._words(data_at, self.points), cpu.cycles - before

    def _words(self, address: int, count: int) -> list[int]:
        return [int(self.cpu.memory[address + n]) for n in range(count)]


def scale_of(points: int) -> float:
    """Of some gyro: small, and no power of two."""
    return 2.0 / points * 3.7e-8


def kernel_cycles(points: int) -> int:
    """What the compiled kernel takes, with the cache on."""
    target = build_target([fft.spectrum_of(points)])
    target.cpu.st = CACHE
    data, amplitude = C3X.array(np.zeros(points)), C3X.array(np.zeros(points // 2))
    target.spectrum(np.arange(points), C3X.encode(scale_of(points)), data, amplitude)
    return target.spectrum.cycles
