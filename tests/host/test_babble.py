"""Lines that carry no frames: other devices, other baud rates, and what the recorder says of them."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from host.babble import Babble, likely_cause
from host.cli import main
from tests.host.test_record import Pty

NMEA = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n" * 40


def through_a_uart(data: bytes, sent_baud: int, read_baud: int) -> bytes:
    """What a receiver at one rate makes of bytes that were sent at another (8N1, idle now and then)."""
    generator = random.Random(1)
    bits: list[int] = []
    for byte in data:
        bits += [0, *(byte >> number & 1 for number in range(8)), 1]
        bits += [1] * 20 if generator.random() < 0.02 else []
    length = sent_baud / read_baud  # of a bit of the receiver's, in bits of the sender's
    received, at = bytearray(), 0.0
    while at < len(bits):
        if bits[int(at)]:
            # idle, or a stop bit: wait for the next start
            following = next((number for number in range(int(at), len(bits)) if not bits[number]), len(bits))
            at = float(following)
            continue
        places = [int(at + (number + 1.5) * length) for number in range(8)]
        received.append(sum(bits[place] << number for number, place in enumerate(places) if place < len(bits)))
        at += 9.5 * length
    return bytes(received)


def test_the_test_knows_a_uart() -> None:
    assert through_a_uart(NMEA, 9600, 9600) == NMEA


LOWER = "its bits come in runs, as from a lower baud rate (see --baud)"
OTHER = "it looks like another baud rate (see --baud) or another protocol"


@pytest.mark.parametrize(
    ("sent_baud", "read_baud", "cause"),
    [
        (9600, 115_200, LOWER),
        (38_400, 115_200, LOWER),
        (57_600, 115_200, LOWER),
        (115_200, 921_600, LOWER),
        (115_200, 57_600, OTHER),
        (115_200, 38_400, OTHER),
        (115_200, 9600, OTHER),
    ],
)
def test_another_baud_rate_shows_in_the_bits(kit: Any, sent_baud: int, read_baud: int, cause: str) -> None:
    for data in (kit.Flight().line(100, described_every=1000), NMEA * 8):
        assert likely_cause(through_a_uart(data, sent_baud, read_baud)) == cause


def test_causes_that_are_no_baud_rate(kit: Any) -> None:
    wrong_crc = b"".join(b"\xeb\x90\x01\x64" + bytes(100) + b"1234" for _ in range(30))
    assert likely_cause(NMEA) == "it looks like NMEA 0183"
    assert likely_cause(b"login: \r\n" * 10) == "it looks like text"
    assert likely_cause(wrong_crc) == "each CRC is wrong (noise, or another version)"
    assert likely_cause(random.Random(1).randbytes(4096)) == OTHER
    assert likely_cause(b"\x00" * 15) == "and too few to tell why"


def test_it_takes_three_seconds_without_a_frame() -> None:
    babble = Babble()
    assert babble.text() == ""
    for tenth in range(30):
        babble.hear(0.1 * tenth, b"%02d" % tenth, 0)
    assert babble.text() == ""
    babble.hear(3.0, b"30", 0)
    first = " ".join(f"30 3{digit}" for digit in range(8))
    assert babble.text() == f"bytes arrive but no frame, it looks like text: {first}"
    babble.hear(3.1, b"...", 1)
    assert babble.text() == ""
    # A frame that was cut off, then silence: that is no babble.
    babble.hear(3.2, b"...", 1)
    babble.hear(3.3, b"...", 1)
    assert babble.text() == ""
    babble.hear(6.3, b"...", 1)
    assert babble.text().startswith("bytes arrive but no frame")


def test_a_recording_of_another_device_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import threading

    port, done = Pty(tmp_path / "port"), threading.Event()

    def talk() -> None:
        while not done.wait(0.2):
            port.write(NMEA[:67])

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        assert main(["record", str(port.link), "--log", str(tmp_path / "a.log"), "--duration", "4"]) == 0
    finally:
        done.set()
        thread.join()
        port.close(remove_link=True)
    error = capsys.readouterr().err
    assert " 0 frames, 0 lost, 0 damaged" in error
    assert "bytes/s; bytes arrive but no frame, it looks like NMEA 0183: " in error
    assert error.count("\n") == 1
