"""Batches: consecutive frames of one layout and one session, as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.schema import Layout
from host.stream import Arrival

UNKNOWN_NS = np.iinfo(np.int64).min


@dataclass(frozen=True, eq=False)
class Batch:
    """Consecutive frames of one layout and one session.

    `rows` are their payloads (uint8, n x layout.size); `arrivals_ns` (int64, n) the host times of the reads that
    brought them, in ns since 1970, UNKNOWN_NS where the file keeps no time.
    """

    layout: Layout
    session: int
    rows: NDArray[np.uint8]
    arrivals_ns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.rows)

    @cached_property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Field name -> values in engineering units (n)."""
        return self.layout.decode_rows(self.rows)

    @property
    def times_ns(self) -> list[int | None]:
        """Host time of the read that brought each frame; None where the file keeps no time."""
        return [None if time == UNKNOWN_NS else time for time in self.arrivals_ns.tolist()]

    @property
    def host_time_s(self) -> NDArray[np.float64]:
        """The same in seconds since 1970 (to a microsecond), nan where the file keeps no time."""
        return np.where(self.arrivals_ns == UNKNOWN_NS, np.nan, self.arrivals_ns * 1e-9)

    def is_continued_by(self, later: Batch) -> bool:
        """True when both can be one batch."""
        return later.layout is self.layout and later.session == self.session


def batches_of(arrivals: Iterable[Arrival]) -> Iterator[Batch]:
    """Arrivals as batches; those of one layout keep their order."""
    by_layout: dict[int, list[Arrival]] = {}
    for arrival in arrivals:
        by_layout.setdefault(id(arrival.layout), []).append(arrival)
    for own in by_layout.values():
        for session, group in groupby(own, key=lambda arrival: arrival.session):
            same, layout = list(group), own[0].layout
            times = [UNKNOWN_NS if arrival.time_ns is None else arrival.time_ns for arrival in same]
            rows = layout.rows_of([arrival.payload for arrival in same])
            yield Batch(layout, session, rows, np.array(times, dtype=np.int64))


def joined(batches: list[Batch]) -> Batch:
    """Batches of one layout and one session as one."""
    if len(batches) == 1:
        return batches[0]
    rows = np.concatenate([batch.rows for batch in batches])
    return Batch(batches[0].layout, batches[0].session, rows, np.concatenate([batch.arrivals_ns for batch in batches]))
