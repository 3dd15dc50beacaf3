"""The monitor, line by line."""

from __future__ import annotations

import pytest

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.errors import UsageError
from firmware_sim.monitor import COMMANDS, Monitor
from firmware_sim.toolchain.assembler import assemble

PROGRAM = """
        .asect  "reset",0
        .word   start, service
        .asect  "program",40h
start:  LDI     @stack,SP
        LDF     1.5,R0
        LDI     -2,R1
        STI     R1,@cell
        LDI     1,IE
        OR      6000h,ST
loop:   ADDI    1,R2
        B       loop
service:
        ADDI    1,R3
        RETI
stack:  .word   87FE00h
cell:   .word   0
"""


@pytest.fixture
def monitor() -> Monitor:
    return Monitor(BoardSheet(), assemble(PROGRAM), "program.out")


def last(text: str) -> list[str]:
    return text.splitlines()[-1].split()


def test_where_shows_the_cycle_and_the_next_instruction(monitor: Monitor) -> None:
    assert monitor.execute("where").splitlines() == ["cycle 0", "start:", " 000040  0834004A  LDI @4Ah,SP"]


def test_step_executes_one_instruction_or_so_many(monitor: Monitor) -> None:
    assert last(monitor.execute("step"))[0] == "000041"
    assert last(monitor.execute("s 2"))[0] == "000043"
    assert monitor.cpu.instructions == 3


def test_registers_show_bits_integers_and_floats(monitor: Monitor) -> None:
    monitor.execute("step 3")
    lines = monitor.execute("regs").splitlines()
    assert lines[0].split() == ["R0", "0040000000", str(0x40000000), "1.5"]
    assert lines[1].split()[:3] == ["R1", "00FFFFFFFE", "-2"]
    assert "SP  0087FE00" in monitor.execute("regs")
    monitor.execute("step 3")
    assert lines != monitor.execute("regs").splitlines()
    assert monitor.execute("regs").splitlines()[-1].split()[-2:] == ["GIE", "INTCONFIG"]


def test_a_run_stops_at_breakpoints_each_time(monitor: Monitor) -> None:
    assert monitor.execute("break loop") == "000046 loop\n"
    for passes in range(3):
        assert monitor.execute("run").startswith("breakpoint at 000046 loop\n")
        assert monitor.cpu.r[2] == passes
    assert "*000046" in monitor.execute("dis loop 1")
    assert last(monitor.execute("step"))[0] == "000047"
    monitor.execute("delete")
    assert monitor.execute("break") == ""
    assert monitor.execute("run 100").splitlines()[0].endswith(" cycles")


def test_a_breakpoint_in_a_service_waits_for_its_interrupt(monitor: Monitor) -> None:
    monitor.execute("b service")
    monitor.execute("r")
    # The first conversion ends 25,250 cycles after power-up; the loop's branch takes at least four more at worst.
    assert 25_250 < monitor.cpu.cycles < 25_270
    monitor.execute("b 49")
    assert monitor.execute("r").startswith("breakpoint at 000049\n")
    assert monitor.cpu.r[3] == 1


def test_memory_and_instructions_are_found_by_symbol_and_by_number(monitor: Monitor) -> None:
    monitor.execute("step 4")
    assert monitor.execute("mem cell 1") == "00004B  FFFFFFFE\n"
    assert monitor.execute("m 4Bh 1") == monitor.execute("m 0x4b 1") == monitor.execute("mem cell 1")
    assert monitor.execute("mem 40 6").splitlines()[1].startswith("000044  ")
    assert monitor.execute("dis loop 2").splitlines()[0] == "loop:"
    assert last(monitor.execute("u 1FFFF 2"))[0] == "020000"


def test_a_program_that_runs_wild_is_shown_and_the_monitor_goes_on() -> None:
    wild = Monitor(BoardSheet(), assemble(PROGRAM.replace("B       loop", "BR      0FFFFFFh")), "wild.out")
    assert "at FFFFFFh, found nothing" in wild.execute("run")
    assert "no memory" in wild.execute("where")
    assert last(wild.execute("regs"))[:2] == ["PC", "FFFFFF"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("jump 5", "a command was expected .* found jump"),
        ("step -1", "a whole number from 1 on was expected, found -1"),
        ("step 0", "a whole number from 1 on was expected, found 0"),
        ("run soon", "found soon"),
        ("mem nowhere", "a symbol or a hexadecimal address was expected, found nowhere"),
        ("mem 1000000", "an address from 0 to FFFFFF was expected"),
        ("mem 810000", "an address with memory behind it was expected, found 810000h"),
        ("break 810000", "an address with memory behind it was expected"),
        ("regs all", "regs: at most 0 argument"),
    ],
)
def test_a_line_that_cannot_be_understood_is_refused(monitor: Monitor, line: str, expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        monitor.execute(line)


def test_comments_and_empty_lines_do_nothing(monitor: Monitor) -> None:
    assert monitor.execute("\n") == monitor.execute("# step\n") == ""
    assert not monitor.is_done
    monitor.execute("q")
    assert monitor.is_done


def test_help_lists_every_command(monitor: Monitor) -> None:
    listed = monitor.execute("help").splitlines()
    assert [line.split(",")[0].split()[0] for line in listed] == [command.names[0] for command in COMMANDS]
