"""A symbolic link to the line's terminal that lives as long as its run does, and never opens somebody else's board.

Beside the link `NAME` lies the file `NAME.lock`: the run that owns the link holds an `flock` on it, and the file says
which terminal the link leads to. The kernel gives the lock up when the process dies, however it dies, so a free lock
means a dead owner; process numbers and terminal numbers are used again and prove nothing.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from firmware_sim.errors import UsageError

_OWNER = "firmware-sim"


class LinkPath:
    """Makes `path` a symbolic link to the first of `devices` (such as `/dev/pts/4`) until `release()`.

    The link's directory is made, with mode 0700, when it is missing. A stale link (its owner died) is replaced.
    Raises UsageError when the link belongs to a running board, when the path is anything that an earlier run did not
    leave there, or when the operating system refuses.
    """

    def __init__(self, path: Path, devices: Sequence[str]) -> None:
        self.path = path.absolute()
        self._devices = tuple(devices)
        with ExitStack() as undo:
            try:
                if _make_directory(self.path.parent):
                    undo.callback(_remove_directory, self.path.parent)
                self._take(undo)
            except OSError as error:
                raise UsageError(f"{self.path}: cannot be made a link to the line: {error}") from error
            self._undo = undo.pop_all()

    def lead_to(self, device: str) -> None:
        """Let the link lead to another of its devices; a link that somebody else has changed stays as it is."""
        with suppress(OSError):
            if self._is_ours():
                self._publish(device)

    def release(self) -> None:
        """Take away the link (if it still leads to this line), the lock, and the directory if this run made it."""
        self._undo.close()

    def _take(self, undo: ExitStack) -> None:
        lock_path = self.path.with_name(self.path.name + ".lock")
        lock_fd = _lock(lock_path, self.path)
        undo.callback(os.close, lock_fd)
        stale_devices = _recorded_devices(lock_fd, lock_path)
        undo.callback(_remove, lock_path)
        self._refuse_what_is_not_ours(stale_devices)
        os.ftruncate(lock_fd, 0)
        os.pwrite(lock_fd, " ".join([_OWNER, str(os.getpid()), *self._devices, "\n"]).encode(), 0)
        undo.callback(self._remove_link)
        self._publish(self._devices[0])

    def _refuse_what_is_not_ours(self, stale_devices: Sequence[str]) -> None:
        if self.path.is_symlink():
            target = str(self.path.readlink())
            if target not in stale_devices:
                raise UsageError(
                    f"{self.path}: expected a free name or the link of an earlier run,"
                    f" found a link to {target} that no run of this program left; remove it or give another name"
                )
        elif self.path.exists():
            raise UsageError(f"{self.path}: expected a free name for the line's link, found something that is no link")

    def _publish(self, device: str) -> None:
        fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}.new")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(device)
        fresh.replace(self.path)

    def _remove_link(self) -> None:
        with suppress(OSError):
            if self._is_ours():
                self.path.unlink()

    def _is_ours(self) -> bool:
        return str(self.path.readlink()) in self._devices


def _make_directory(directory: Path) -> bool:
    """Whether this call made it."""
    try:
        directory.mkdir(mode=0o700)
    except FileExistsError:
        return False
    return True


def _remove_directory(directory: Path) -> None:
    # Somebody else's files in it are a reason to leave it, not an error.
    with suppress(OSError):
        directory.rmdir()


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


def _lock(lock_path: Path, link: Path) -> int:
    """The descriptor of the locked file; the lock ends with the descriptor or the process."""
    while True:
        lock_fd = os.open(lock_path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock_fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = _record(lock_fd)
            os.close(lock_fd)
            raise UsageError(
                f"{link}: expected a free name, found the link of a running board ({owner}); give another name"
            ) from None
        # Its owner may have removed the file between the open and the lock: then the lock guards nothing.
        if _is_still(lock_path, lock_fd):
            return lock_fd
        os.close(lock_fd)


def _is_still(path: Path, fd: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(fd))
    except FileNotFoundError:
        return False


def _recorded_devices(lock_fd: int, lock_path: Path) -> list[str]:
    """The terminals that the lock's last owner linked to; none for a new lock."""
    words = _record(lock_fd).split()
    if words and words[0] != _OWNER:
        raise UsageError(f"{lock_path}: expected a lock of {_OWNER}, found a file of somebody else; give another name")
    return words[2:]


def _record(lock_fd: int) -> str:
    return os.pread(lock_fd, 400, 0).decode(errors="replace").strip()
