"""The link to the line: there while its run lives, gone after, never somebody else's."""

import os
import signal
import stat
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from firmware_sim.board.line import PtyLine
from firmware_sim.board.link_path import LinkPath
from firmware_sim.errors import UsageError

BOARD = """
import signal, sys
from contextlib import closing
from pathlib import Path
from firmware_sim.board.line import PtyLine
signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
with closing(PtyLine(Path(sys.argv[1]))) as line:
    print(line.device, flush=True)
    line.idle(600.0)
"""


@pytest.fixture
def board(tmp_path):
    """Starts boards in processes of their own, whose link is tmp_path/run/ttyBOARD; ends what is left of them."""
    processes = []

    def start():
        process = subprocess.Popen(
            [sys.executable, "-c", BOARD, str(tmp_path / "run" / "ttyBOARD")],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        processes.append(process)
        assert process.stdout.readline().startswith("/dev/pts/")
        return process

    yield start
    for process in processes:
        process.kill()
        process.wait()
        process.stdout.close()


def test_link_leads_to_the_line_and_goes_with_it(tmp_path):
    link = tmp_path / "run" / "ttyBOARD"
    with closing(PtyLine(link)) as line:
        assert str(link.readlink()) == line.device
        assert stat.S_IMODE(link.parent.stat().st_mode) == 0o700
    assert not link.parent.exists()


def test_directory_that_was_there_stays(tmp_path):
    with closing(PtyLine(tmp_path / "ttyBOARD")):
        assert (tmp_path / "ttyBOARD").is_symlink()
    assert list(tmp_path.iterdir()) == []


def test_directory_with_other_files_stays(tmp_path):
    link = tmp_path / "run" / "ttyBOARD"
    with closing(PtyLine(link)):
        (tmp_path / "run" / "notes").write_text("mine")
    assert [path.name for path in link.parent.iterdir()] == ["notes"]


def test_relative_link_is_found_again_from_another_directory(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    with closing(PtyLine(Path("ttyBOARD"))):
        monkeypatch.chdir(tmp_path / "elsewhere")
    assert [path.name for path in tmp_path.iterdir()] == ["elsewhere"]


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_link_goes_when_a_signal_ends_the_run(board, tmp_path, sign):
    process = board()
    process.send_signal(sign)
    process.wait(60)
    assert list(tmp_path.iterdir()) == []


def test_link_goes_when_an_exception_ends_the_run(tmp_path):
    with pytest.raises(ZeroDivisionError), closing(PtyLine(tmp_path / "ttyBOARD")):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_stale_link_of_a_killed_board_is_replaced(board, tmp_path):
    process = board()
    process.kill()
    process.wait()
    link = tmp_path / "run" / "ttyBOARD"
    assert link.is_symlink()
    with closing(PtyLine(link)) as line:
        assert str(link.readlink()) == line.device
    assert list(link.parent.iterdir()) == []


def test_link_of_a_running_board_is_refused_and_unharmed(board, tmp_path):
    process = board()
    link = tmp_path / "run" / "ttyBOARD"
    target = link.readlink()
    with pytest.raises(UsageError, match=rf"running board \(firmware-sim {process.pid} "):
        PtyLine(link)
    assert link.readlink() == target
    process.terminate()
    process.wait(60)
    assert not link.parent.exists()


def test_second_line_of_the_same_process_is_refused_too(tmp_path):
    link = tmp_path / "ttyBOARD"
    with closing(PtyLine(link)) as line:
        with pytest.raises(UsageError, match="running board"):
            PtyLine(link)
        assert str(link.readlink()) == line.device


@pytest.mark.parametrize("kind", ["file", "directory", "dangling", "other link"])
def test_what_is_not_ours_is_refused_and_unharmed(tmp_path, kind):
    link = tmp_path / "ttyBOARD"
    if kind == "file":
        link.write_text("precious")
    elif kind == "directory":
        link.mkdir()
    else:
        link.symlink_to("/dev/pts/99999" if kind == "dangling" else tmp_path)
    before = os.lstat(link)
    with pytest.raises(UsageError, match="ttyBOARD: expected a free name"):
        PtyLine(link)
    assert os.path.samestat(os.lstat(link), before)
    assert list(tmp_path.iterdir()) == [link]


def test_lock_file_of_somebody_else_is_refused_and_unharmed(tmp_path):
    (tmp_path / "ttyBOARD.lock").write_text("precious")
    with pytest.raises(UsageError, match=r"ttyBOARD\.lock: expected a lock of firmware-sim"):
        LinkPath(tmp_path / "ttyBOARD", ["/dev/pts/1"])
    assert (tmp_path / "ttyBOARD.lock").read_text() == "precious"


def test_link_in_a_directory_that_cannot_be_made_is_refused(tmp_path):
    with pytest.raises(UsageError, match="No such file or directory"):
        PtyLine(tmp_path / "no" / "such" / "ttyBOARD")


def test_link_leads_to_another_of_its_devices(tmp_path):
    path = tmp_path / "run" / "ttyBOARD"
    link = LinkPath(path, ["/dev/pts/1", "/dev/pts/2"])
    assert str(path.readlink()) == "/dev/pts/1"
    link.lead_to("/dev/pts/2")
    assert str(path.readlink()) == "/dev/pts/2"
    link.release()
    link.release()
    assert not path.parent.exists()


def test_link_that_somebody_changed_is_left_alone(tmp_path):
    path = tmp_path / "ttyBOARD"
    link = LinkPath(path, ["/dev/pts/1", "/dev/pts/2"])
    path.unlink()
    path.symlink_to("/dev/pts/7")
    link.lead_to("/dev/pts/2")
    link.release()
    assert str(path.readlink()) == "/dev/pts/7"
    assert list(tmp_path.iterdir()) == [path]
