"""The commands for machine code: what they write, and that every mistake is one sentence and status 2."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest

from firmware_sim import cli
from firmware_sim.toolchain.coff import read_coff, write_coff
from firmware_sim.toolchain.image import Image, Section, SectionKind

PROGRAM = """
        .asect  "reset",0
        .word   start
        .asect  "program",40h
start:  LDI     5,R0
stop:   B       stop
"""
RUN = ["run", "static", "--engine", "iss", "--duration", "0.1"]


@pytest.fixture
def image(tmp_path: Path) -> Path:
    source, path = tmp_path / "program.asm", tmp_path / "program.out"
    source.write_text(PROGRAM)
    assert cli.main(["asm", str(source), "-o", str(path)]) == 0
    return path


def status_and_sentence(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[object, str]:
    try:
        status: object = cli.main([str(argument) for argument in arguments])
    except SystemExit as ended:
        status = ended.code
    said = capsys.readouterr().err
    assert "Traceback" not in said
    return status, said


def test_asm_writes_an_image_and_a_listing(tmp_path: Path, image: Path) -> None:
    words = read_coff(image.read_bytes(), "program.out").sections["program"].words
    assert words == [0x08600005, 0x6A00FFFF]
    listing = tmp_path / "program.lst"
    cli.main(["asm", str(tmp_path / "program.asm"), "-o", str(image), "--listing", str(listing)])
    rows = [line.split() for line in listing.read_text().splitlines()]
    assert ["000040", "08600005", "1", "start:", "LDI", "5,R0"] in rows


def test_sources_of_one_image_share_their_names(tmp_path: Path) -> None:
    (tmp_path / "a.asm").write_text("        .global there\n        .text\n        BR there\n")
    (tmp_path / "b.asm").write_text("        .def there\n        .text\nthere:  NOP\n")
    path = tmp_path / "both.out"
    assert cli.main(["asm", str(tmp_path / "a.asm"), str(tmp_path / "b.asm"), "-o", str(path)]) == 0
    assert read_coff(path.read_bytes(), "both.out").sections[".text"].words == [0x60000001, 0x0C800000]


def test_asm_takes_folders_and_definitions(tmp_path: Path) -> None:
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder in folders:
        folder.mkdir()
    (folders[0] / "ports.equ").write_text("PORT .set 7\n")
    (folders[1] / "size.equ").write_text("SIZE .set 9\n")
    source, path = tmp_path / "main.asm", tmp_path / "main.out"
    source.write_text(
        "        .include ports.equ\n        .include size.equ\n"
        "        .if DEBUG\n        LDI PORT,R0\n        .endif\n        LDI SIZE+RATE,R1\n"
    )
    options = [*(text for folder in folders for text in ("-I", str(folder))), "-D", "DEBUG", "-DRATE=0FFh"]
    assert cli.main(["asm", str(source), "-o", str(path), *options]) == 0
    assert read_coff(path.read_bytes(), "main.out").sections[".text"].words == [0x0860_0007, 0x0861_0108]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["-D", "5=1"], "-D 5=1: expected a name, = and an integer"),
        (["-D", "A="], "-D A=: expected a name, = and an integer"),
        (["-D", "A=B"], "-D A=B: expected a name, = and an integer"),
        (["-D", "A=1.5"], "-D A=1.5: expected a name, = and an integer"),
        (["-I", "nowhere"], "-I nowhere: expected a folder, found none"),
    ],
)
def test_options_of_asm_that_say_nothing_are_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, options: list[str], sentence: str
) -> None:
    source = tmp_path / "program.asm"
    source.write_text(PROGRAM)
    status, said = status_and_sentence(capsys, "asm", source, "-o", tmp_path / "program.out", *options)
    assert (status, said) == (2, f"firmware-sim: {sentence}\n")


def test_a_part_of_a_program_can_be_assembled_alone(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    source, path = tmp_path / "part.asm", tmp_path / "part.out"
    source.write_text("        .ref there, table\n        .text\n        CALL there\n        LDI @table,R0\n")
    status, said = status_and_sentence(capsys, "asm", source, "-o", path)
    assert status == 2
    assert f"{source}:3:14: a defined name was expected, found there" in said
    status, said = status_and_sentence(capsys, "asm", source, "-o", path, "--allow-undefined")
    assert (status, said) == (0, "firmware-sim: undefined and taken as 0: table, there\n")
    assert read_coff(path.read_bytes(), "part.out").sections[".text"].words == [0x6200_0000, 0x0820_0000]


def test_dis_prints_the_instructions(capsys: pytest.CaptureFixture[str], image: Path) -> None:
    assert cli.main(["dis", str(image)]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["LDI", "5,R0", ";", "000040", "08600005", "1"] in rows


def test_errors_of_a_source_name_their_places(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    source = tmp_path / "wrong.asm"
    source.write_text("        .text\n        LDQ 5,R0\n        ADDI 5\n")
    status, said = status_and_sentence(capsys, "asm", source, "-o", tmp_path / "wrong.out")
    assert status == 2
    assert f"{source}:2:" in said
    assert f"{source}:3:" in said
    assert not (tmp_path / "wrong.out").exists()


@pytest.mark.parametrize("command", [["dis"], [*RUN, "--image"]])
def test_an_image_that_cannot_be_read_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, image: Path, command: list[str]
) -> None:
    truncated, foreign = tmp_path / "truncated.out", tmp_path / "foreign.out"
    truncated.write_bytes(image.read_bytes()[:100])
    foreign.write_bytes(b"\x7fELF" + bytes(100))
    for path in (tmp_path / "missing.out", truncated, foreign, tmp_path):
        status, said = status_and_sentence(capsys, *command, path)
        assert status == 2
        assert said.startswith(f"firmware-sim: {path}")
        assert said.count("\n") == 1


def test_an_image_that_is_larger_than_memory_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "large.out"
    path.write_bytes(write_coff(Image({".text": Section(".text", 0x1FFFF, [1, 2], SectionKind.TEXT)}, {}, 0x1FFFF)))
    status, said = status_and_sentence(capsys, *RUN, "--image", path)
    assert status == 2
    assert "section .text: expected memory of the board" in said
    assert "found 01FFFFh-020000h" in said


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["asm", "-o", "x.out"], "SRC.asm"),
        (["asm", "missing.asm", "-o", "x.out"], "missing.asm"),
        (["asm", "missing.asm"], "-o"),
        (["build", "-o", "no/such/folder/x.out"], "expected a file that can be written"),
        (["build", "--start", "nowhere"], "nowhere"),
        (["run", "static", "--image", "x.out"], "--image: expected with --engine iss, found --engine c3x"),
        (["run", "static", "--trace", "x.txt"], "--trace: expected with --engine iss, found --engine c3x"),
        (["run", "static", "--vcd", "x.vcd"], "--vcd: expected with --engine iss, found --engine c3x"),
        (["debug", "missing.out"], "missing.out: expected a readable image"),
        ([*RUN, "--timing", "slow"], "invalid choice: 'slow'"),
    ],
)
def test_a_mistake_is_one_sentence(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, said = status_and_sentence(capsys, *arguments)
    assert status == 2
    assert expected in said
    assert list(tmp_path.iterdir()) == []


def test_a_program_that_runs_wild_ends_the_run(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    source, path = tmp_path / "wild.asm", tmp_path / "wild.out"
    source.write_text(PROGRAM.replace("B       stop", "BR      0FFFFFFh"))
    cli.main(["asm", str(source), "-o", str(path)])
    capsys.readouterr()
    status, said = status_and_sentence(capsys, *RUN, "--image", path)
    assert status == 2
    assert "at FFFFFFh" in said
    assert "000041h BR" in said


def test_a_run_reports_what_it_measured(image: Path, tmp_path: Path) -> None:
    path, raw = tmp_path / "report.json", tmp_path / "line.raw"
    assert cli.main([*RUN, "--image", str(image), "--report", str(path), "--raw", str(raw)]) == 0
    report = json.loads(path.read_text())
    assert report["engine"] == "iss"
    assert report["timing_is"] == "measured"
    assert report["duration_s"] == 0.1
    assert report["nav_cycles"] == 0
    assert report["errors_vs_truth"] is None
    assert report["errors_vs_double"] is None
    # The program reads none of the 119 samples whose conversions ended; the last of them still waits.
    assert report["adc"] == {"samples": 0, "lost": 118}
    assert raw.read_bytes() == b""
    assert cli.main([*RUN, "--image", str(image), "--report", str(path), "--timing", "fast"]) == 0
    assert json.loads(path.read_text())["timing_is"] == "measured without the pipeline"


def test_a_trace_has_each_instruction_with_its_cycle(image: Path, tmp_path: Path) -> None:
    trace = tmp_path / "trace.txt"
    run = ["run", "static", "--engine", "iss", "--duration", "0.02", "--timing", "fast", "--image", str(image)]
    assert cli.main([*run, "--trace", str(trace)]) == 0
    rows = [line.split() for line in trace.read_text().splitlines()]
    assert rows[0] == ["0", "000040", "08600005", "LDI", "5,R0"]
    assert [row[1] for row in rows[1:]] == ["000041"] * (len(rows) - 1)
    # The branch to itself takes four cycles; the flight is a tick, and ends just before the next.
    assert [int(row[0]) for row in rows[1:]] == list(range(1, 999_999, 4))


@pytest.mark.parametrize("option", ["--trace", "--vcd"])
def test_a_recording_that_cannot_be_written_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, image: Path, option: str
) -> None:
    for path in (tmp_path / "missing" / "file", Path("/dev/full")):
        status, said = status_and_sentence(capsys, *RUN, "--image", image, option, path)
        assert status == 2
        assert said.startswith(f"firmware-sim: {path}: expected a file that can be written")
        assert said.count("\n") == 1


@pytest.mark.parametrize("option", ["--trace", "--vcd"])
def test_a_recording_does_not_destroy_what_the_run_uses(
    capsys: pytest.CaptureFixture[str], image: Path, option: str
) -> None:
    before = image.read_bytes()
    status, said = status_and_sentence(capsys, *RUN, "--image", image, option, image)
    assert status == 2
    assert "expected a file of its own" in said
    assert image.read_bytes() == before


def test_a_dump_without_its_library_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, image: Path
) -> None:
    monkeypatch.delitem(sys.modules, "firmware_sim.value_changes", raising=False)
    monkeypatch.setitem(sys.modules, "vcd", None)
    path = tmp_path / "run.vcd"
    status, said = status_and_sentence(capsys, *RUN, "--image", image, "--vcd", path)
    assert status == 2
    assert said == "firmware-sim: --vcd needs pyvcd, which is not installed: pip install 'firmware-sim[vcd]'\n"
    assert not path.exists()


def test_debug_is_driven_by_a_script(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, image: Path
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("step\nregs\nquit\nstep\n"))
    assert cli.main(["debug", str(image)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("cycle 0\nstart:\n 000040  08600005  LDI 5,R0\n")
    assert "R0  0000000005" in said
    assert said.count("cycle") == 2


def test_a_script_with_a_mistake_ends_with_status_2(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, image: Path
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("stop\nstep\n"))
    status, said = status_and_sentence(capsys, "debug", image)
    assert status == 2
    assert said == "firmware-sim: a command was expected (try: help), found stop\n"


def test_a_source_is_not_overwritten_by_what_is_made_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.asm").write_text("    NOP\n")
    for arguments in (["asm", "a.asm", "-o", "a.asm"], ["asm", "a.asm", "-o", "a.out", "--listing", "./a.asm"]):
        assert cli.main(arguments) == 2
        assert "expected a file of its own, found one that this run also uses" in capsys.readouterr().err
    assert cli.main(["build", "-o", "b.out", "--map", "b.out"]) == 2
    assert Path("a.asm").read_text() == "    NOP\n"
