"""The cache of machine code: stale code must be impossible."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import firmware_sim
from firmware_sim import jit

SOURCE = "from firmware_sim.jit import jit\n\n@jit\ndef double_of(x):\n    return 2 * x\n"


def test_a_generated_module_is_written_once_and_imported_once():
    first = jit.import_generated("probe", SOURCE)
    assert jit.import_generated("probe", SOURCE) is first
    assert first.double_of(21) == 42
    assert Path(first.__file__).read_text() == SOURCE


def test_another_source_is_another_module():
    other = jit.import_generated("probe", SOURCE.replace("2 * x", "3 * x"))
    assert other.double_of(14) == 42
    assert other.__file__ != jit.import_generated("probe", SOURCE).__file__


def test_a_damaged_file_of_the_cache_is_made_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "CACHE_ROOT", tmp_path)
    made = []

    def remembered():
        return jit.remembered("list", "key", jit.__file__, lambda: made.append(1) or ["x" * 50])

    assert remembered() == remembered() == ["x" * 50]
    assert len(made) == 1
    (path,) = (tmp_path / "made").iterdir()
    whole = path.read_bytes()
    middle = len(whole) - 30  # inside the text: what pickle would not notice
    for damaged in (b"", whole[:20], whole[:-1], whole[:middle] + b"y" + whole[middle + 1 :], b"\x80\x05}." * 30):
        path.write_bytes(damaged)
        assert remembered() == ["x" * 50]
        assert path.read_bytes() == whole
    assert len(made) == 6


@pytest.fixture
def package_copy(tmp_path):
    """A copy of the package's lowest rooms that may be edited, with a cache of its own."""
    package = tmp_path / "firmware_sim"
    for name in ("__init__.py", "errors.py", "jit.py"):
        target = package / name
        target.parent.mkdir(exist_ok=True)
        target.write_text((Path(firmware_sim.__file__).parent / name).read_text())
    (package / "leaf.py").write_text("from firmware_sim.jit import jit\n\n@jit\ndef leaf(x):\n    return x + 1\n")
    (package / "middle.py").write_text(
        "from firmware_sim.jit import jit\nfrom firmware_sim.leaf import leaf\n\n"
        "@jit\ndef middle(x):\n    return leaf(x)\n"
    )
    (package / "top.py").write_text(
        "from firmware_sim.jit import jit\nfrom firmware_sim import middle as room\n\nmiddle = room.middle\n\n"
        "@jit\ndef top(x):\n    return 10 * middle(x)\n"
    )

    def run() -> str:
        """What ``top(1)`` gives in a process of its own."""
        command = "from firmware_sim.top import top; print(top(1), sum(top.stats.cache_hits.values()))"
        environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
        return subprocess.run(
            [sys.executable, "-c", command], cwd=tmp_path, env=environment, check=True, capture_output=True, text=True
        ).stdout.strip()

    return package, run


def test_an_edit_of_an_indirectly_imported_file_is_seen(package_copy):
    package, run = package_copy
    assert run() == "20 0"
    assert run() == "20 1"
    leaf = package / "leaf.py"
    times = leaf.stat()
    leaf.write_text(leaf.read_text().replace("x + 1", "x + 2"))
    os.utime(leaf, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert run() == "30 0"


def test_an_edit_elsewhere_costs_no_compilation(package_copy):
    package, run = package_copy
    assert run() == "20 0"
    (package / "stranger.py").write_text("x = 1\n")
    assert run() == "20 1"


def test_files_of_one_name_do_not_make_a_second_compilation(package_copy):
    package, run = package_copy
    # Sets of paths have another order in each process.
    for room in "abcdef":
        (package / room).mkdir()
        (package / room / "leaf.py").write_text(f"x = '{room}'\n")
    imports = "".join(f"from firmware_sim.{room}.leaf import x as {room}\n" for room in "abcdef")
    (package / "top.py").write_text(imports + (package / "top.py").read_text())
    assert run() == "20 0"
    assert [run() for _ in range(4)] == ["20 1"] * 4
