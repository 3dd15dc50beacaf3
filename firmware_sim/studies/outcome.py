"""What a study is and what it gives: sentences, tables and figures, written into a folder."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from firmware_sim.errors import UsageError
from firmware_sim.studies.figures import Chart, draw

Cell = str | float
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Table:
    """Rows under named columns; ``name`` becomes the name of its file. ``digits``: significant ones, in text."""

    name: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    digits: int = 3

    def csv(self) -> str:
        """Comma-separated, numbers with all the digits that repeat them."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(self.rows)
        return stream.getvalue()

    def text(self) -> str:
        """Aligned columns, texts to the left and numbers to the right."""
        cells = [list(self.columns), *([self._shown(cell) for cell in row] for row in self.rows)]
        widths = [max(len(row[column]) for row in cells) for column in range(len(self.columns))]
        is_text = [any(isinstance(row[column], str) for row in self.rows) for column in range(len(self.columns))]
        lines = [
            "  ".join(
                cell.ljust(width) if left else cell.rjust(width)
                for cell, width, left in zip(row, widths, is_text, strict=True)
            ).rstrip()
            for row in cells
        ]
        return "\n".join(lines) + "\n"

    def _shown(self, cell: Cell) -> str:
        if isinstance(cell, str):
            return cell
        magnitude = abs(cell)
        if magnitude == 0.0 or 1e-4 <= magnitude < 10.0**self.digits:
            return f"{cell:#.{self.digits}g}".rstrip(".")
        return f"{cell:,.0f}" if 1.0 <= magnitude < 1e9 else f"{cell:.{self.digits - 1}e}"


@dataclass(frozen=True)
class Outcome:
    """The answer of a study."""

    sentences: Sequence[str]
    tables: Sequence[Table]
    charts: Sequence[Chart] = ()

    def text(self) -> str:
        """Sentences and tables, as the terminal and ``NAME.txt`` show them."""
        return "\n".join([*self.sentences, *(f"\n{table.text()}" for table in self.tables)]).rstrip() + "\n"


@dataclass(frozen=True)
class Settings:
    """What the user may set. ``duration_s`` None is the study's own; ``recorded`` a file to lay over the curves."""

    duration_s: float | None = None
    seed: int = 0
    scenario: str | None = None
    recorded: Path | None = None


@dataclass(frozen=True)
class Study:
    """A question with a name; ``options`` are the settings beside duration and seed that it takes."""

    name: str
    question: str
    run: Callable[[Settings, Progress], Outcome]
    options: frozenset[str] = field(default_factory=frozenset)


def write_outcome(outcome: Outcome, name: str, directory: Path) -> list[Path]:
    """Write ``NAME.txt``, a CSV of each table and a PNG of each chart into a folder, which is made; give their paths.

    Raises UsageError where that fails, and without matplotlib.
    """
    paths = []
    try:
        directory.mkdir(parents=True, exist_ok=True)
        texts = {f"{name}.txt": outcome.text(), **{f"{table.name}.csv": table.csv() for table in outcome.tables}}
        for file_name, text in texts.items():
            path = directory / file_name
            path.write_text(text, encoding="utf-8")
            paths.append(path)
        paths += [draw(chart, directory) for chart in outcome.charts]
    except OSError as error:
        raise UsageError(f"{directory}: expected a folder that can be written, found: {error.strerror}") from None
    return paths
