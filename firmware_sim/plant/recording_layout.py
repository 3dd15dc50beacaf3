"""How a foreign recording is laid out: names of channels, units, rate and axes, as a scenario file declares them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from firmware_sim.errors import UsageError
from firmware_sim.plant.earth import STANDARD_GRAVITY_MPS2
from firmware_sim.plant.recording import Recording
from firmware_sim.plant.source import Floats

_DEG = np.pi / 180.0
# A unit: its weight in SI, and whether it is a rate (else an increment over the sample).
GYRO_UNITS = {
    "radps": (1.0, True),
    "degps": (_DEG, True),
    "degph": (_DEG / 3600.0, True),
    "rad": (1.0, False),
    "deg": (_DEG, False),
    "arcsec": (_DEG / 3600.0, False),
}
ACC_UNITS = {"mps2": (1.0, True), "g": (STANDARD_GRAVITY_MPS2, True), "mps": (1.0, False)}
SENSOR_UNITS = {"gyro": GYRO_UNITS, "acc": ACC_UNITS}
# Right, forward, up in terms of the words for directions.
_DIRECTIONS = {
    "right": (1, 0, 0),
    "left": (-1, 0, 0),
    "forward": (0, 1, 0),
    "backward": (0, -1, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
}
BODY_AXES = "right forward up"
_SPAN = re.compile(r"(?P<name>\w+)\((?P<first>\d+):(?P<last>\d+)\)")


@dataclass(frozen=True)
class Layout:
    """What a scenario file says of a recording; empty texts and None where it says nothing.

    ``gyro`` and ``acc`` name three channels, or one array of three; ``where`` begins a complaint.
    """

    gyro: str = ""
    acc: str = ""
    gyro_unit: str = ""
    acc_unit: str = ""
    rate_hz: float | None = None
    axes: str = ""
    where: str = "[recording]"

    @property
    def names_channels(self) -> bool:
        """Whether it says what the channels are called; without, they have their usual names."""
        return bool(self.gyro or self.acc or self.gyro_unit or self.acc_unit)

    def names(self, sensor: str) -> list[str]:
        """Names of the channels of ``gyro`` or ``acc``: three, or one that has three. Raises UsageError."""
        text = str(getattr(self, sensor))
        names = [name for name in re.split(r"[,\s]+", text) if name]
        if len(names) not in (1, 3):
            raise UsageError(
                f"{self.where} {sensor}: expected one name of an array of three, or three names, found {text!r}"
            )
        return names

    def weight(self, sensor: str) -> tuple[float, bool]:
        """Weight in SI of the unit of ``gyro`` or ``acc``, and whether it is a rate. Raises UsageError."""
        units, unit = SENSOR_UNITS[sensor], str(getattr(self, f"{sensor}_unit"))
        if unit not in units:
            found = repr(unit) if unit else "none"
            raise UsageError(f"{self.where} {sensor}_unit: expected one of {', '.join(units)}, found {found}")
        return units[unit]

    def weights(self, rate_hz: float) -> Floats:
        """What turns each channel into increments, rad and m/s a sample, (6,)."""
        pairs = [self.weight("gyro"), self.weight("acc")]
        return np.repeat([weight / rate_hz if is_rate else weight for weight, is_rate in pairs], 3)


def span_of(name: str) -> tuple[str, int, int] | None:
    """``imu(4:6)`` as name, first and last component, counted from 1; None for a plain name."""
    match = _SPAN.fullmatch(name)
    return None if match is None else (match["name"], int(match["first"]), int(match["last"]))


def axes_matrix(text: str, where: str) -> Floats:
    """The rotation from the file's axes to right-forward-up, (3, 3), from the directions of its x, y and z.

    Raises UsageError for a word that is no direction, for two axes along one line, and for a left-handed triad.
    """
    words = [word for word in re.split(r"[,\s]+", text) if word]
    if len(words) != 3 or any(word not in _DIRECTIONS for word in words):
        raise UsageError(
            f"{where}: expected the directions of x, y and z of {', '.join(_DIRECTIONS)}, such as"
            f" 'forward right down', found {text!r}"
        )
    matrix = np.array([_DIRECTIONS[word] for word in words], dtype=float).T
    determinant = round(float(np.linalg.det(matrix)))
    if determinant != 1:
        found = "a left-handed triad" if determinant else "two axes along one line"
        raise UsageError(
            f"{where}: expected a right-handed triad such as 'forward right down', found {found}: {text!r}"
        )
    return matrix


def with_axes(recording: Recording, axes: str, where: str) -> Recording:
    """The recording in body axes right-forward-up, for data whose x, y and z point as ``axes`` says."""
    if not axes or axes == BODY_AXES:
        return recording
    matrix = axes_matrix(axes, where)
    return replace(recording, chunks=lambda: _turned(recording.chunks, matrix))


def _turned(chunks: Callable[[], Iterator[Floats]], matrix: Floats) -> Iterator[Floats]:
    for rows in chunks():
        turned = np.array(rows)
        # A sum of one term and two zeros each: exact, counts stay whole.
        turned[:, :3] = rows[:, :3] @ matrix.T
        turned[:, 3:6] = rows[:, 3:6] @ matrix.T
        yield turned
