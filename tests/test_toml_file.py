"""Reading TOML files: what is accepted, and one sentence for what is not."""

from __future__ import annotations

import pytest

from firmware_sim.errors import UsageError
from firmware_sim.toml_file import in_words, read_toml


def written(folder, content):
    path = folder / "some.toml"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_byte_order_mark_and_either_end_of_line(tmp_path, mark, end):
    text = mark + end.join([b"# caf\xc3\xa9", b"a = 1", b"[b]", b'c = "d"', b""])
    assert read_toml(written(tmp_path, text), "board file") == {"a": 1, "b": {"c": "d"}}


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"a = 1\n[b\n", "found: Expected ']' at the end of a table declaration (at line 2, column 3)"),
        (b"a = '\xff'", "found no UTF-8 text at byte 6"),
        (b"\xef\xbb\xbfa = '\xff'", "found no UTF-8 text at byte 9"),
        (b"a = " + b"[" * 20_000, "found values nested too deeply"),
        (b"a = " + b"9" * 5_000, "found an integer of too many digits"),
    ],
)
def test_what_is_no_toml(tmp_path, content, complaint):
    path = written(tmp_path, content)
    with pytest.raises(UsageError) as caught:
        read_toml(path, "board file")
    assert str(caught.value) == f"{path}: expected TOML, {complaint}"


def test_what_is_no_file(tmp_path):
    inside_a_file = written(tmp_path, b"") / "none.toml"
    for path, found in ((tmp_path / "x.toml", "No such file or directory"), (inside_a_file, "Not a directory")):
        with pytest.raises(UsageError) as caught:
            read_toml(path, "board file")
        assert str(caught.value) == f"{path}: expected a readable board file, found: {found}"


def test_values_in_words(tmp_path):
    lines = {
        "1979-05-27": "a date",
        "1979-05-27T07:32:00Z": "a date with a time",
        "07:32:00": "a time",
        "true": "true",
        "{ b = 1 }": "a table",
        "[{ b = 1 }]": "an array of tables",
        "[1, 2]": "an array",
        "[]": "an array",
        "-1.5": "-1.5",
        "nan": "nan",
        "'fast'": "'fast'",
        "'" + "x" * 100 + "'": "'" + "x" * 59 + "...",
    }
    for text, words in lines.items():
        assert in_words(read_toml(written(tmp_path, f"a = {text}".encode()), "board file")["a"]) == words
