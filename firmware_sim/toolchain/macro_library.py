"""Macro libraries (SPRU035, .mlib): an archive of sources, each of which defines the macro that it is named after.

The archive is the one of Unix and of COFF: ``!<arch>`` and a line end, then members, each a header of 60 characters
and its contents, padded to an even length. A longer name than the 16 characters of its field stands in the member
``//``, at the offset that the field says behind its slash.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from firmware_sim.toolchain.diagnostics import SourceError

_MAGIC: Final = b"!<arch>\n"
_HEADER_BYTES: Final = 60
_NAME: Final = slice(0, 16)
_SIZE: Final = slice(48, 58)
_END: Final = slice(58, 60)
_END_OF_HEADER: Final = b"`\n"
_EXTENSION: Final = ".asm"


def read_library(path: Path) -> dict[str, str]:
    """The sources of the library by the names of their macros, in small letters. Raises SourceError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SourceError(f"a macro library was expected, found {path} ({error.strerror})") from error
    if not data.startswith(_MAGIC):
        raise SourceError(f"a macro library was expected, found {path}, which is no archive")
    sources = {}
    long_names = b""
    for field, contents in _members(data, path):
        if field == b"//":
            long_names = contents
        name = _name(field, long_names).lower()
        if name.endswith(_EXTENSION):
            sources[name.removesuffix(_EXTENSION)] = contents.decode("latin-1")
    return sources


def _members(data: bytes, path: Path) -> Iterator[tuple[bytes, bytes]]:
    """The name fields and the contents of the members."""
    offset = len(_MAGIC)
    while offset < len(data):
        header = data[offset : offset + _HEADER_BYTES]
        digits = header[_SIZE].strip()
        start = offset + _HEADER_BYTES
        if header[_END] != _END_OF_HEADER or not digits.isdigit() or start + int(digits) > len(data):
            raise SourceError(f"a member of an archive was expected at byte {offset} of {path}, found none")
        end = start + int(digits)
        yield header[_NAME].rstrip(), data[start:end]
        offset = end + end % 2


def _name(field: bytes, long_names: bytes) -> str:
    if field[:1] == b"/" and field[1:].isdigit():
        field = long_names[int(field[1:]) :].split(b"\n")[0]
    return field.decode("latin-1").rstrip("/")
