"""What the line says about its own frames: field descriptions in, layouts out, payloads decoded to columns.

The description frame (type 0) is specified in the interface control document.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import count
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.frames import MAX_PAYLOAD_BYTES

DESCRIPTION_TYPE = 0
_DESCRIPTION = struct.Struct("<BBBBBBd")
_TEXTS = 5
# No raw value times such a scale, nor a difference of two of them, is beyond the numbers of the host.
_LARGEST_SCALE = 1e200


class Kind(IntEnum):
    """What the value of a field is."""

    QUANTITY = 0
    FLAGS = 1
    ENUMERATION = 2


_KINDS = frozenset(Kind)


@dataclass(frozen=True)
class FieldType:
    """How a field stands in the payload: its name, its code in descriptions and its size."""

    name: str
    code: int
    size: int


_TYPES = (("u8", 1), ("u16", 2), ("u32", 4), ("i32", 4), ("single", 4))
FIELD_TYPES = {code: FieldType(name, code, size) for code, (name, size) in enumerate(_TYPES, start=1)}
SINGLE = FIELD_TYPES[5]


def c3x_single_to_float(words: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Values (n) of TMS320C3x single-precision words (n), exactly."""
    values = np.empty(len(words))
    _scan().single_values(words, values)
    return values


@dataclass(frozen=True)
class Field:
    """One described field: value in `unit` = raw value x `scale`; `labels` name bits or values, from 0."""

    name: str
    type: FieldType
    offset: int
    kind: Kind
    scale: float
    unit: str
    meaning: str
    labels: tuple[str, ...]

    @property
    def title(self) -> str:
        """Name with unit, as columns and axes are headed."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def bit_name(self, bit: int) -> str:
        return self._label(bit) or f"bit {bit}"

    def words(self, value: int) -> str:
        """The value of an enumeration or the set flags in words; no flag gives an empty text."""
        if self.kind is Kind.FLAGS:
            bits = range(8 * self.type.size)
            return "|".join(self.bit_name(bit) for bit in bits if value >> bit & 1)
        return self._label(value) or f"value {value}"

    def lane_names(self) -> tuple[str, ...]:
        """A word for each bit of flags, or for each value of an enumeration that has a label."""
        if self.kind is Kind.FLAGS:
            return tuple(self.bit_name(bit) for bit in range(8 * self.type.size))
        return self.labels

    def _label(self, number: int) -> str:
        return self.labels[number] if 0 <= number < len(self.labels) else ""

    @property
    def is_integer(self) -> bool:
        """True where the values are whole numbers, as they stand in the payload (int64); others are float64."""
        return self.type is not SINGLE and (self.kind is not Kind.QUANTITY or self.scale == 1.0)


@dataclass(frozen=True)
class Layout:
    """All fields of one frame type, in their order."""

    type: int
    name: str
    fields: tuple[Field, ...]

    @cached_property
    def size(self) -> int:
        """Bytes of payload that the fields reach over."""
        return max(field.offset + field.type.size for field in self.fields)

    @cached_property
    def by_name(self) -> dict[str, Field]:
        return {field.name: field for field in self.fields}

    @cached_property
    def sequence(self) -> Field | None:
        """The running number of the frames, if they have one."""
        found = self.by_name.get("sequence")
        return None if found is None or found.type is SINGLE else found

    def number_of(self, payload: bytes) -> tuple[int, int] | None:
        """The running number of a frame, and the modulus at which it wraps; None without one."""
        if self.sequence is None:
            return None
        at, size = self.sequence.offset, self.sequence.type.size
        return int.from_bytes(payload[at : at + size], "little"), 1 << 8 * size

    @cached_property
    def _plan(self) -> tuple[NDArray[np.int64], NDArray[np.float64], int, int]:
        """What `host.scan.decode_payloads` needs: the fields, their scales, how many are float64 and how many int64."""
        numbers = {True: count(), False: count()}
        rows = [
            (each.offset, each.type.code, not each.is_integer, next(numbers[each.is_integer])) for each in self.fields
        ]
        scales = np.array([each.scale for each in self.fields])
        return np.array(rows, dtype=np.int64), scales, next(numbers[False]), next(numbers[True])

    @cached_property
    def _places(self) -> list[tuple[str, bool, int]]:
        """The name of each field, whether its values are whole numbers, and its row among those."""
        plan = self._plan[0].tolist()
        return [(each.name, not is_float, row) for each, (_, _, is_float, row) in zip(self.fields, plan, strict=True)]

    def rows_of(self, payloads: Sequence[bytes]) -> NDArray[np.uint8]:
        """Payloads of at least `size` bytes as rows of so many."""
        joined = bytearray().join(payload[: self.size] for payload in payloads)
        return np.frombuffer(joined, dtype=np.uint8).reshape(-1, self.size)

    def decode_rows(self, rows: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
        """Columns in engineering units, one value for each row (n x `size`, a payload each); float64 or int64."""
        fields, scales, float_count, integer_count = self._plan
        floats = np.empty((float_count, len(rows)))
        integers = np.empty((integer_count, len(rows)), np.int64)
        _scan().decode_payloads(rows, fields, scales, floats, integers)
        return {name: (integers if is_integer else floats)[row] for name, is_integer, row in self._places}

    def decode(self, payloads: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """The same for payloads of at least `size` bytes."""
        return self.decode_rows(self.rows_of(payloads))

    def decode_values(self, payload: bytes) -> dict[str, int | float]:
        """The values of one payload in engineering units."""
        return {name: column[0].item() for name, column in self.decode([payload]).items()}


def prepare_decoding() -> None:
    """Compiles what decodes payloads, which must not happen while a line waits to be read."""
    Layout(255, "", (Field("byte", FIELD_TYPES[1], 0, Kind.QUANTITY, 1.0, "", "", ()),)).decode([b"\0"])


@dataclass(frozen=True)
class _Description:
    frame_type: int
    index: int
    count: int
    frame_name: str
    field: Field


def _scan() -> ModuleType:
    """Imported by those who want values: a recorder starts without numba."""
    from host import scan

    return scan


def _parse(payload: bytes) -> _Description | None:
    """The description in a payload of type 0, or None where it breaks the rules of the document."""
    if len(payload) < _DESCRIPTION.size:
        return None
    frame_type, index, count, type_code, offset, kind_code, scale = _DESCRIPTION.unpack_from(payload)
    try:
        texts = payload[_DESCRIPTION.size :].decode("utf-8").split("\0")
    except UnicodeDecodeError:
        return None
    # Five texts, each ended by a zero: a sixth, empty piece follows the last.
    if len(texts) != _TEXTS + 1 or texts[-1] or not "".join(texts).isprintable():
        return None
    field_type = FIELD_TYPES.get(type_code)
    if field_type is None or kind_code not in _KINDS:
        return None
    frame_name, name, unit, meaning, labels = texts[:_TEXTS]
    words_of_a_single = field_type is SINGLE and kind_code != Kind.QUANTITY
    if frame_type == DESCRIPTION_TYPE or index >= count or offset + field_type.size > MAX_PAYLOAD_BYTES:
        return None
    if not name or not 0.0 < abs(scale) <= _LARGEST_SCALE or words_of_a_single:
        return None
    names = tuple(labels.split("|")) if labels else ()
    field = Field(name, field_type, offset, Kind(kind_code), scale, unit, meaning, names)
    return _Description(frame_type, index, count, frame_name or f"type {frame_type}", field)


class Schema:
    """The frame types that the line has described completely so far (`layouts`, by type).

    A description that contradicts an earlier one of its frame type starts that type anew: it is unknown again until
    all its fields have come. `malformed` counts descriptions that break the rules; nothing is ever raised for them.
    """

    def __init__(self) -> None:
        self.layouts: dict[int, Layout] = {}
        self.malformed = 0
        self.replaced = 0
        # Changes with every description that says something new; one that breaks the rules says nothing.
        self.version = 0
        self._seen: dict[int, dict[int, _Description]] = {}
        self._payloads: dict[bytes, bytes] = {}

    @property
    def known(self) -> Collection[bytes]:
        """Payloads of descriptions that would say nothing new: at most one of each frame type and index."""
        return self._payloads.values()

    def learn(self, payload: bytes) -> Layout | None:
        """Takes the payload of a description frame; gives the layout that it completed, if it did."""
        key = payload[:2]
        if self._payloads.get(key) == payload:
            return None
        description = _parse(payload)
        if description is None:
            self.malformed += 1
            return None
        self.version += 1
        frame_type = description.frame_type
        if self._contradicts(description):
            self._forget(frame_type)
            self.replaced += 1
        seen = self._seen.setdefault(frame_type, {})
        seen[description.index] = description
        self._payloads[key] = payload
        if len(seen) < description.count:
            return None
        return self._complete(frame_type)

    def _contradicts(self, new: _Description) -> bool:
        seen = self._seen.get(new.frame_type, {})
        return any(
            (old.count, old.frame_name) != (new.count, new.frame_name) or old.index == new.index
            for old in seen.values()
        )

    def _forget(self, frame_type: int) -> None:
        for index in self._seen.pop(frame_type):
            del self._payloads[bytes((frame_type, index))]
        self.layouts.pop(frame_type, None)

    def _complete(self, frame_type: int) -> Layout | None:
        seen = self._seen[frame_type]
        fields = tuple(seen[index].field for index in sorted(seen))
        if len({field.name for field in fields}) < len(fields):
            # Two fields of one name cannot both have a column.
            self._forget(frame_type)
            self.malformed += 1
            return None
        layout = Layout(frame_type, seen[0].frame_name, fields)
        self.layouts[frame_type] = layout
        return layout
