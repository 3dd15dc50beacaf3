"""The history of a frame: what it gives back is what the columns were, from memory and from the temporary file."""

from __future__ import annotations

import errno
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from host import history as history_module
from host.batch import batches_of
from host.curves import Columns
from host.errors import UsageError
from host.history import History
from host.live.logbook import Logbook
from host.log import Chunk, Kind, LogWriter
from host.source import Recording, open_source
from host.stream import Stream

NAMES = (Columns.TIME, "sequence", "heading", "latitude", "solver_cycles", "flags: overrun")
START_NS = 1_790_000_000 * 10**9


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory, kit: Any) -> Path:
    """Two sessions, the second after a restart; a heading that passes north; irregular arrivals."""
    path = tmp_path_factory.mktemp("log") / "a.log"
    numbers = [*range(6000), *range(2, 3000)]
    with LogWriter(path) as writer:
        writer.event(START_NS, Kind.OPENED, "port")
        writer.data(START_NS, kit.descriptions())
        for count, number in enumerate(numbers):
            writer.data(START_NS + 20_000_000 * count + 1000 * (count * 7919 % 997), kit.Flight().frame(number))
    return path


def expected_rows(log: Path) -> Any:
    columns = Columns()
    found = [columns.of(batch) for batch in open_source(log).batches(Recording())]
    return np.vstack([np.concatenate([batch[name] for batch in found]) for name in NAMES])


@pytest.mark.parametrize("memory_bytes", [1 << 23, 1000], ids=["in memory", "in a file"])
def test_all_rows_come_back(log: Path, memory_bytes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history_module, "_MEMORY_BYTES", memory_bytes)
    batches = list(open_source(log).batches(Recording()))
    history = History(batches[0].layout, NAMES)
    added = np.concatenate([history.add(batch) for batch in batches], axis=1)
    expected = expected_rows(log)
    np.testing.assert_array_equal(added, expected)
    # Angles are unwrapped by sums of turns, whose roundings depend on where they begin.
    whole = np.concatenate(list(history.rows(-1.0, 1e9)), axis=1)
    np.testing.assert_allclose(whole, expected, rtol=0.0, atol=1e-12 * 1e3)
    inside = np.concatenate(list(history.rows(119.0, 121.0)), axis=1)
    time = expected[0]
    np.testing.assert_allclose(inside, expected[:, (time >= 119.0) & (time <= 121.0)], rtol=0.0, atol=1e-9)
    assert len(history.columns.session_starts) == 1


def test_frame_by_frame_is_the_same_as_a_whole_log(log: Path) -> None:
    stream, history = Stream(), None
    for item in open_source(log).items():
        if hasattr(item, "data"):
            for batch in batches_of(stream.feed(item.data, item.time_ns)):
                history = history or History(batch.layout, NAMES)
                history.add(batch)
    assert history is not None
    batches = list(open_source(log).batches(Recording()))
    at_once = History(batches[0].layout, NAMES)
    for batch in batches:
        at_once.add(batch)
    for window in ((0.0, 180.0), (50.0, 60.0), (118.0, 122.0)):
        for points in (10, 100, 1000):
            one, other = history.window(*window, points), at_once.window(*window, points)
            # Unwrapping adds turns in another order.
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)


def test_a_peak_of_one_frame_shows_in_the_whole(log: Path) -> None:
    (history,) = {History(batch.layout, NAMES) for batch in list(open_source(log).batches(Recording()))[:1]}
    for batch in open_source(log).batches(Recording()):
        history.add(batch)
    expected, window = expected_rows(log), history.window(0.0, 200.0, 20)
    np.testing.assert_array_equal(np.nanmax(window, axis=1), np.nanmax(expected, axis=1))
    np.testing.assert_array_equal(np.nanmin(window, axis=1), np.nanmin(expected, axis=1))


class FullDisk(io.BytesIO):
    """A file with room for so many bytes; it takes a part of what is too long, as a disk does."""

    room = 50_000

    def write(self, data: Any) -> int:
        taken = min(len(data), self.room - self.tell())
        if taken <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data[:taken])


@pytest.mark.parametrize("memory_bytes", [60_000, 1000], ids=["when it moves to a file", "in the file"])
def test_a_full_disk_costs_no_row_that_was_kept(log: Path, memory_bytes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history_module, "_MEMORY_BYTES", memory_bytes)
    monkeypatch.setattr(history_module.tempfile, "TemporaryFile", lambda buffering: FullDisk())
    stream, history, expected = Stream(), None, []
    for item in open_source(log).items():
        for batch in batches_of(stream.feed(item.data, item.time_ns)) if isinstance(item, Chunk) else ():
            history = history or History(batch.layout, NAMES)
            rows = history.add(batch)
            if not history.failure:
                expected.append(rows)
            if len(stream.sessions) > 1:
                # Somebody made room.
                monkeypatch.setattr(FullDisk, "room", 10**9)
    assert history is not None
    assert 3000 < len(expected) < 6000
    kept = np.concatenate(expected, axis=1)
    assert kept[1, 400] == 400
    # Angles are unwrapped by sums of turns.
    np.testing.assert_allclose(np.concatenate(list(history.rows(-1.0, 1e9)), axis=1), kept, rtol=0.0, atol=1e-9)


def test_a_full_disk_is_told(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history_module, "_MEMORY_BYTES", 1000)
    monkeypatch.setattr(history_module.tempfile, "TemporaryFile", lambda buffering: FullDisk())
    with pytest.raises(UsageError, match="cannot take the frames: No space left on device"):
        Logbook(open_source(log))
