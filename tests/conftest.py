"""What tests of several rooms share."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser import chromium

_RECORDING = "rlg_static_100Hz_1847s.npz"
_BESIDE_THE_CHECKOUT = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def recording_path() -> Path:
    """The complete recording, which is not part of the project, for tests marked ``needs_recording``.

    It is looked for in the folder that FIRMWARE_SIM_DATA names and in ``../shared/data`` beside the checkout.
    """
    named = os.environ.get("FIRMWARE_SIM_DATA")
    folders = [Path(named)] if named else []
    for folder in [*folders, _BESIDE_THE_CHECKOUT]:
        if (folder / _RECORDING).is_file():
            return folder / _RECORDING
    pytest.skip(f"{_RECORDING} is neither in FIRMWARE_SIM_DATA nor in {_BESIDE_THE_CHECKOUT}")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A real browser for the tests of a file."""
    with chromium() as running:
        yield running
