"""Compiled code as text that a person reads: each line of the kernels' source above the instructions made of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from firmware_sim.kernels.code_c3x import Jump, Label, Line
from firmware_sim.kernels.flat import Origin
from firmware_sim.kernels.source_text import lines_of


def text_of(code: Sequence[Line]) -> list[str]:
    """Assembly, with each line of the source above the first of its instructions."""
    lines: list[str] = []
    shown = None
    for line in code:
        if isinstance(line, Label):
            lines.append(f"{line.name}:")
            continue
        if line.origin != shown:
            shown = line.origin
            lines.append(f"; {Path(shown.file).name}:{shown.line}  {source_line(shown)}")
        if isinstance(line, Jump):
            lines.append(f"            {line.mnemonic:<8}{line.target}".rstrip())
            lines += [f"            {slot}" for slot in line.slots]
        else:
            lines.append(f"            {line}")
    return lines


def source_line(origin: Origin) -> str:
    text = lines_of(origin.file)
    return text[origin.line - 1].strip() if 0 < origin.line <= len(text) else ""
