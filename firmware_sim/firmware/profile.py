"""Where the cycles of a stretch of execution went: by function and by line of the source."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.firmware.code_map import CodeMap, Place

_SHOWN_LINES: Final = 15
_SHOWN_FUNCTIONS: Final = 20


@dataclass(frozen=True)
class Profile:
    """Cycles by function and by line, the greatest first. ``what`` says of what."""

    what: str
    functions: tuple[tuple[str, int], ...]
    lines: tuple[tuple[Place, int], ...]

    @property
    def cycles(self) -> int:
        return sum(cycles for _, cycles in self.functions)

    def table(self, lines: int = _SHOWN_LINES) -> str:
        """As text: the functions, then the most expensive lines."""
        total = max(1, self.cycles)
        rows = [f"{self.what}: {self.cycles} cycles", "", "cycles      %  function"]
        rows += [f"{cycles:>6} {cycles / total:>6.1%}  {name}" for name, cycles in self.functions[:_SHOWN_FUNCTIONS]]
        rows += ["", "cycles      %  line"]
        for place, cycles in self.lines[:lines]:
            rows.append(f"{cycles:>6} {cycles / total:>6.1%}  {place.file}:{place.line}  {place.text}")
        return "\n".join(rows) + "\n"

    def as_dict(self) -> dict[str, Any]:
        """For a JSON document."""
        return {
            "what": self.what,
            "cycles": self.cycles,
            "functions": [{"name": name, "cycles": cycles} for name, cycles in self.functions],
            "lines": [
                {"file": place.file, "line": place.line, "text": place.text, "cycles": cycles}
                for place, cycles in self.lines
            ],
        }


def profile_of(what: str, rows: NDArray[np.int64], code: CodeMap) -> Profile:
    """From executed instructions, (n, 2) of cycle and address: each takes the time to the next, the last a cycle."""
    cycles = np.diff(rows[:, 0], append=rows[-1:, 0] + 1)
    by_address: Counter[int] = Counter()
    for address, taken in zip(rows[:, 1].tolist(), cycles.tolist(), strict=True):
        by_address[address] += taken
    functions: Counter[str] = Counter()
    lines: Counter[Place] = Counter()
    for address, taken in by_address.items():
        place = code.place(address)
        functions[place.function] += taken
        lines[place] += taken
    return Profile(what, tuple(functions.most_common()), tuple(lines.most_common()))
