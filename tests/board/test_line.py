"""The line against real terminals: what a reader gets is what was written, whatever the reader does."""

import os
import random
import select
import subprocess
import termios
import threading
from contextlib import closing, suppress
from io import FileIO
from pathlib import Path
from time import monotonic

import pytest
import serial
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_sim.board import line as line_module
from firmware_sim.board import spill_queue, terminal
from firmware_sim.board.line import FileLine, Ledger, Line, NullLine, Pacer, PtyLine
from firmware_sim.board.spill_queue import SpillQueue
from firmware_sim.errors import UsageError

GUARD_S = 60.0
EVERY_BYTE = bytes(range(256))


def serve_until(line, condition):
    """Serve until the condition holds; the time only ends a test that would hang."""
    end = monotonic() + GUARD_S
    while not condition():
        assert monotonic() < end, f"never came; {line.ledger}"
        line.idle(0.001)


def read_now(fd, count=65536):
    with suppress(BlockingIOError):
        return os.read(fd, count)
    return b""


def open_plain(device):
    """As `cat` opens: no flush, no change of mode."""
    return os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def collect(line, read, count):
    """Serve and read until `count` bytes have come."""
    got = bytearray()

    def complete():
        got.extend(read())
        return len(got) >= count

    serve_until(line, complete)
    return bytes(got)


def balanced(ledger):
    return ledger.sent == ledger.read + ledger.held + ledger.dropped


# What a reader gets


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_twenty_readers_in_turn_lose_double_and_swap_nothing(seed, tmp_path):
    """Each opens the link at once after the last one closed it, with no regard for what the board has noticed."""
    link = tmp_path / "run" / "ttyBOARD"
    data = random.Random(seed).randbytes(60_000)
    got = bytearray()

    def read_in_twenty_sessions():
        rng = random.Random(seed + 1000)
        for _ in range(20):
            with serial.Serial(str(link), 115200, timeout=0.02) as port:
                for _ in range(rng.randrange(4)):
                    got.extend(port.read(rng.randrange(1, 400)))
        with serial.Serial(str(link), 115200, timeout=0.02) as port:
            end = monotonic() + GUARD_S
            while len(got) < len(data) and monotonic() < end:
                got.extend(port.read(port.in_waiting or 1))

    rng = random.Random(seed + 2000)
    with closing(PtyLine(link)) as line:
        reader = threading.Thread(target=read_in_twenty_sessions)
        reader.start()
        rest = data
        while rest:
            burst = rng.randrange(1, 1000)
            line.write(rest[:burst])
            rest = rest[burst:]
            line.idle(rng.choice([0.0, 0.001, 0.005]))
            line.service()
        serve_until(line, lambda: not reader.is_alive())
        reader.join()
    assert bytes(got) == data
    assert line.ledger == Ledger(sent=len(data), read=len(data), held=0, dropped=0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_twenty_readers_of_the_terminal_itself(seed):
    """Without a link a reader must leave the line the time of one service; here it waits for just that."""
    rng = random.Random(seed)
    got = bytearray()
    written = bytearray()
    with closing(PtyLine()) as line:
        for _ in range(20):
            with serial.Serial(line.device, 115200, timeout=0) as port:
                for _ in range(rng.randrange(6)):
                    burst = rng.randbytes(rng.randrange(500))
                    written += burst
                    line.write(burst)
                    line.service()
                    got += port.read(rng.randrange(1, 100))
            line.service()
            assert not line.attached
        with serial.Serial(line.device, 115200, timeout=0) as port:
            got += collect(line, lambda: port.read(4096), len(written) - len(got))
    assert got == written
    assert line.ledger == Ledger(sent=len(written), read=len(written), held=0, dropped=0)


def test_cat_is_a_reader(tmp_path):
    data = EVERY_BYTE * 100
    with closing(PtyLine()) as line, (tmp_path / "got").open("wb") as got:
        line.write(data)
        cat = subprocess.Popen(["cat", line.device], stdout=got, stderr=subprocess.DEVNULL)
        line.drain(GUARD_S)
        serve_until(line, lambda: (tmp_path / "got").stat().st_size >= len(data))
        cat.terminate()
        cat.wait()
    assert (tmp_path / "got").read_bytes() == data


def test_late_reader_gets_all_that_came_before():
    data = random.Random(4).randbytes(30_000)
    with closing(PtyLine()) as line:
        for begin in range(0, len(data), 100):
            line.write(data[begin : begin + 100])
            line.service()
        assert line.ledger == Ledger(sent=len(data), read=0, held=len(data), dropped=0)
        with serial.Serial(line.device, timeout=0) as port:
            assert collect(line, lambda: port.read(4096), len(data)) == data


def test_reader_that_never_flushes_gets_all():
    with closing(PtyLine()) as line:
        line.write(EVERY_BYTE)
        reader = open_plain(line.device)
        assert collect(line, lambda: read_now(reader), 256) == EVERY_BYTE
        os.close(reader)


def test_nothing_is_given_before_a_new_reader_had_the_time_to_flush(monkeypatch):
    now = [1000.0]
    for module in (line_module, terminal):
        monkeypatch.setattr(module, "monotonic", lambda: now[0])
    with closing(PtyLine()) as line:
        line.write(b"wait")
        reader = open_plain(line.device)
        line.service()
        assert line.attached
        now[0] += 0.059
        line.service()
        assert read_now(reader) == b""
        now[0] += 0.002
        line.service()
        assert collect_from(reader, 4) == b"wait"
        os.close(reader)


def collect_from(reader, count):
    """Read without serving the line; what was written to a terminal may take the kernel a moment."""
    got = b""
    end = monotonic() + GUARD_S
    while len(got) < count and monotonic() < end:
        got += read_now(reader)
    return got


def test_what_a_reader_left_unread_comes_first_for_the_next():
    data = random.Random(5).randbytes(1000)
    with closing(PtyLine()) as line:
        line.write(data)
        with serial.Serial(line.device, timeout=0) as port:
            serve_until(line, lambda: port.in_waiting > 10)
            got = port.read(10)
        line.service()
        assert line.ledger == Ledger(sent=1000, read=10, held=990, dropped=0)
        with serial.Serial(line.device, timeout=0) as port:
            got += collect(line, lambda: port.read(4096), 990)
    assert got == data


def test_at_most_64_bytes_lie_in_the_kernel_before_a_reader_reads():
    with closing(PtyLine()) as line:
        line.write(bytes(1000))
        with serial.Serial(line.device, timeout=0) as port:
            serve_until(line, lambda: port.in_waiting > 0)
            for _ in range(10):
                line.service()
            assert port.in_waiting == 64


def test_a_steady_reader_is_given_more_at_a_time_up_to_2048_bytes():
    given_at_once = []
    with closing(PtyLine()) as line, closing(serial.Serial(line.device, timeout=0)) as port:
        line.write(bytes(30_000))
        while line.ledger.held:
            serve_until(line, lambda: port.in_waiting > 0 or not line.ledger.held)
            given_at_once.append(len(b"".join(iter(lambda: port.read(4096), b""))))
    assert given_at_once[:7] == [64, 128, 256, 512, 1024, 2048, 2048]
    assert max(given_at_once) == 2048


def test_flush_after_the_settling_time_loses_nothing():
    """A slow program: its flush comes when the first bytes are there already."""
    data = random.Random(6).randbytes(500)
    with closing(PtyLine()) as line:
        line.write(data)
        reader = open_plain(line.device)
        with serial.Serial(line.device, timeout=0) as port:
            serve_until(line, lambda: port.in_waiting > 0)
            port.reset_input_buffer()
            port.reset_input_buffer()
            assert collect(line, lambda: port.read(4096), 500) == data
        os.close(reader)


def test_flush_of_a_reader_that_has_read_is_its_own_decision():
    data = random.Random(7).randbytes(500)
    with closing(PtyLine()) as line, closing(serial.Serial(line.device, timeout=0)) as port:
        line.write(data)
        got = collect(line, lambda: port.read(4096), 64)
        serve_until(line, lambda: port.in_waiting > 0)
        line.service()
        lost = port.in_waiting
        port.reset_input_buffer()
        got += collect(line, lambda: port.read(4096), 500 - len(got) - lost)
        line.drain(GUARD_S)
    cut = len(got) - len(data) + lost
    assert cut == 0
    assert data.startswith(got[:64])
    assert data.endswith(got[-64:])
    assert line.ledger == Ledger(sent=500, read=500, held=0, dropped=0)


def test_a_mode_that_a_reader_leaves_behind_ends_with_it():
    with closing(PtyLine()) as line:
        line.write(EVERY_BYTE)
        reader = open_plain(line.device)
        serve_until(line, lambda: select.select([reader], [], [], 0)[0])
        mode = termios.tcgetattr(reader)
        mode[0] |= termios.ICRNL | termios.ISTRIP
        mode[3] |= termios.ICANON | termios.ECHO
        termios.tcsetattr(reader, termios.TCSANOW, mode)
        os.close(reader)
        line.service()
        reader = open_plain(line.device)
        assert collect(line, lambda: read_now(reader), 256) == EVERY_BYTE
        os.close(reader)


def test_second_reader_of_the_link_waits_for_the_first_to_leave(tmp_path):
    link = tmp_path / "ttyBOARD"
    with closing(PtyLine(link)) as line:
        first = serial.Serial(str(link), timeout=0)
        line.service()
        second = serial.Serial(str(link), timeout=0)
        line.write(b"for the first")
        assert collect(line, lambda: first.read(100), 13) == b"for the first"
        assert second.read(100) == b""
        first.close()
        line.write(b"for the second")
        assert collect(line, lambda: second.read(100), 14) == b"for the second"
        second.close()


def test_device_is_open_again_after_a_reader_of_the_link(tmp_path):
    with closing(PtyLine(tmp_path / "ttyBOARD")) as line:
        for path in (tmp_path / "ttyBOARD", line.device, line.device, tmp_path / "ttyBOARD"):
            line.write(EVERY_BYTE)
            with serial.Serial(str(path), timeout=0) as port:
                assert collect(line, lambda port=port: port.read(4096), 256) == EVERY_BYTE
            line.service()


# What the board gets


@pytest.mark.parametrize("reader_type", ["pyserial", "plain"])
def test_every_byte_value_reaches_the_board(reader_type):
    with closing(PtyLine()) as line:
        line.service()
        if reader_type == "pyserial":
            with serial.Serial(line.device, timeout=0) as port:
                port.write(EVERY_BYTE)
                assert collect(line, line.service, 256) == EVERY_BYTE
        else:
            reader = open_plain(line.device)
            os.write(reader, EVERY_BYTE)
            assert collect(line, line.service, 256) == EVERY_BYTE
            os.close(reader)
        assert line.service() == b""


def test_words_of_a_host_that_left_at_once_reach_the_board():
    with closing(PtyLine()) as line:
        with serial.Serial(line.device) as port:
            port.write(b"mode 2\n")
        assert collect(line, line.service, 7) == b"mode 2\n"


def test_input_that_came_while_the_line_idled_waits_for_service():
    with closing(PtyLine()) as line, closing(serial.Serial(line.device)) as port:
        port.write(b"abc")
        line.idle(0.01)
        line.drain(0.01)
        assert collect(line, line.service, 3) == b"abc"


# Policies


def test_drop_without_a_reader_drops():
    with closing(PtyLine(policy="drop")) as line:
        line.write(bytes(1000))
        line.service()
        line.drain(GUARD_S)
        assert line.ready()
    assert line.ledger == Ledger(sent=1000, read=0, held=0, dropped=1000)


def test_drop_loses_the_newest_bytes_of_a_slow_reader():
    data = random.Random(8).randbytes(20_000)
    with closing(PtyLine(policy="drop")) as line, closing(serial.Serial(line.device, timeout=0)) as port:
        line.service()
        line.write(data)
        assert line.ledger.dropped == 20_000 - 4096
        assert collect(line, lambda: port.read(4096), 4096) == data[:4096]
        line.drain(GUARD_S)
    assert line.ledger == Ledger(sent=20_000, read=4096, held=0, dropped=20_000 - 4096)


def test_drop_forgets_what_a_reader_left():
    with closing(PtyLine(policy="drop")) as line:
        with serial.Serial(line.device, timeout=0) as port:
            line.service()
            line.write(bytes(1000))
            serve_until(line, lambda: port.in_waiting > 0)
            assert len(port.read(10)) == 10
        line.service()
        assert line.ledger == Ledger(sent=1000, read=10, held=0, dropped=990)


def test_wait_stops_virtual_time_until_all_is_read():
    with closing(PtyLine(policy="wait")) as line:
        assert line.ready()
        line.write(EVERY_BYTE)
        line.service()
        assert not line.ready()
        with serial.Serial(line.device, timeout=0) as port:
            got = b""
            while not line.ready():
                assert len(got) < 256 or line.ledger.held
                line.idle(0.001)
                got += port.read(4096)
            assert got == EVERY_BYTE
    assert line.ledger == Ledger(sent=256, read=256, held=0, dropped=0)


def test_idle_ends_when_a_waiting_line_becomes_ready():
    with closing(PtyLine(policy="wait")) as line:
        line.write(b"x")
        cat = subprocess.Popen(["cat", line.device], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        line.idle(10 * GUARD_S)
        assert line.ready()
        cat.terminate()
        cat.wait()


def test_unknown_policy_is_refused():
    with pytest.raises(UsageError, match="hold, drop, wait, found 'keep'"):
        PtyLine(policy="keep")


# The end of a run


def test_drain_gives_up_when_nobody_reads():
    with closing(PtyLine()) as line:
        line.write(b"unread")
        line.drain(0.01)
    assert line.ledger == Ledger(sent=6, read=0, held=6, dropped=0)


class EndedError(Exception):
    pass


def ended_at(count):
    """What ends a wait at its ``count``-th call."""
    calls = iter(range(count - 1))

    def look():
        if next(calls, None) is None:
            raise EndedError

    return look


def test_a_drain_looks_while_nobody_reads():
    with closing(PtyLine()) as line:
        line.write(b"unread")
        with pytest.raises(EndedError):
            line.drain(GUARD_S, ended_at(3))
    assert line.ledger == Ledger(sent=6, read=0, held=6, dropped=0)


def test_what_an_attached_reader_has_not_read_at_close_is_held():
    with closing(PtyLine()) as line, closing(serial.Serial(line.device, timeout=0)) as port:
        line.write(bytes(100))
        serve_until(line, lambda: port.in_waiting > 0)
        assert len(port.read(7)) == 7
        line.close()
        assert line.ledger == Ledger(sent=100, read=7, held=93, dropped=0)


def test_close_may_be_called_again_and_gives_every_descriptor_back(tmp_path):
    def descriptors():
        return sorted(os.listdir("/proc/self/fd"))  # noqa: PTH208

    before = descriptors()
    line = PtyLine(tmp_path / "ttyBOARD", memory_limit_bytes=1)
    line.write(b"to memory and to a file")
    line.close()
    line.close()
    assert descriptors() == before


# The account

OPERATIONS = st.lists(
    st.one_of(
        st.tuples(st.just("write"), st.integers(0, 3000)),
        st.tuples(st.just("read"), st.integers(1, 3000)),
        st.tuples(st.sampled_from(["serve", "open", "close"]), st.just(0)),
    ),
    max_size=40,
)


@settings(deadline=None, max_examples=150)
@example(operations=[("open", 0), ("write", 1), ("write", 1), ("close", 0)], policy="drop", memory=0)
@given(operations=OPERATIONS, policy=st.sampled_from(["hold", "drop", "wait"]), memory=st.integers(0, 2000))
def test_ledger_balances_and_counts_what_was_read(operations, policy, memory):
    data = random.Random(9).randbytes(40 * 3000)
    sent, got, port = 0, bytearray(), None
    line = PtyLine(policy=policy, memory_limit_bytes=memory)
    for operation, count in operations:
        if operation == "write":
            line.write(data[sent : sent + count])
            sent += count
        elif operation == "read" and port:
            got += port.read(count)
        elif operation == "open" and not port:
            port = serial.Serial(line.device, timeout=0)
        elif operation == "close" and port:
            port.close()
            port = None
        line.service()
        assert balanced(line.ledger)
        assert line.ledger.sent == sent
        # The line may not know yet that the last bytes given to the kernel are read.
        assert line.ledger.read <= len(got)
    line.close()
    if port:
        port.close()
    assert line.ledger.read == len(got)
    assert balanced(line.ledger)
    if policy != "drop":
        assert line.ledger.dropped == 0
        assert data.startswith(bytes(got))


def test_a_ledger_that_does_not_balance_is_an_internal_error():
    line = NullLine()
    line.write(b"abc")
    line._dropped = 2
    with pytest.raises(RuntimeError, match="does not balance"):
        line.close()


# The queue


@settings(deadline=None, max_examples=200)
@given(
    operations=st.lists(st.tuples(st.sampled_from(["put", "take", "put back"]), st.integers(0, 500)), max_size=60),
    memory=st.integers(0, 600),
)
def test_spill_queue_is_a_queue(operations, memory):
    source = random.Random(10).randbytes(60 * 500)
    model, put, taken = bytearray(), 0, b""
    with closing(SpillQueue(memory)) as queue:
        for operation, count in operations:
            if operation == "put":
                queue.put(source[put : put + count])
                model += source[put : put + count]
                put += count
            elif operation == "take":
                taken = queue.take(count)
                assert len(taken) <= count
                assert bool(taken) == bool(model and count)
                assert taken == model[: len(taken)]
                del model[: len(taken)]
            else:
                queue.put_back(taken)
                model[:0] = taken
                taken = b""
            assert len(queue) == len(model)
        assert b"".join(iter(lambda: queue.take(100), b"")) == model


def test_held_bytes_go_to_a_file_and_come_back_in_order():
    data = random.Random(11).randbytes(300_000)
    with closing(PtyLine(memory_limit_bytes=1000)) as line:
        for begin in range(0, len(data), 7001):
            line.write(data[begin : begin + 7001])
        assert line.ledger.held == len(data)
        with serial.Serial(line.device, timeout=0) as port:
            assert collect(line, lambda: port.read(4096), len(data)) == data


def test_full_disk_is_one_sentence_and_the_ledger_still_balances(monkeypatch):
    monkeypatch.setattr(spill_queue.tempfile, "TemporaryFile", lambda buffering: FileIO("/dev/full", "r+"))
    line = PtyLine(memory_limit_bytes=10)
    with pytest.raises(UsageError, match="No space left on device"):
        line.write(bytes(100))
    line.close()
    assert line.ledger == Ledger(sent=100, read=0, held=10, dropped=90)


# The lines without a terminal


def test_null_line_drops_and_counts():
    with closing(NullLine()) as line:
        line.write(b"abc")
        line.write(b"de")
        line.drain(GUARD_S)
        line.idle(0.0)
        assert line.ready()
        assert line.service() == b""
    assert line.ledger == Ledger(sent=5, read=0, held=0, dropped=5)


def test_file_line_writes_the_exact_bytes(tmp_path):
    path = tmp_path / "line.raw"
    path.write_bytes(b"an older run, longer than this one" * 100)
    with closing(FileLine(path)) as line:
        line.write(EVERY_BYTE)
        line.write(EVERY_BYTE)
        assert path.read_bytes() == EVERY_BYTE * 2
    assert line.ledger == Ledger(sent=512, read=512, held=0, dropped=0)


def test_file_line_says_why_it_cannot_open(tmp_path):
    with pytest.raises(UsageError, match=r"missing/line\.raw: .*No such file or directory"):
        FileLine(tmp_path / "missing" / "line.raw")


def test_file_line_counts_what_did_not_fit():
    line = FileLine(Path("/dev/full"))
    with pytest.raises(UsageError, match=r"/dev/full: .*No space left on device"):
        line.write(b"abc")
    line.close()
    assert line.ledger == Ledger(sent=3, read=0, held=0, dropped=3)


# Real time


class ClockLine(NullLine):
    """Idling moves a clock that moves by nothing else, in steps as an interrupted wait would."""

    now_s = 50.0

    def idle(self, seconds):
        self.now_s += min(seconds, 0.03)


@pytest.fixture
def clock_line(monkeypatch):
    line = ClockLine()
    monkeypatch.setattr(line_module, "monotonic", lambda: line.now_s)
    return line


@pytest.mark.parametrize("ratio", [0.5, 1.0, 20.0])
def test_pacer_keeps_the_ratio(clock_line, ratio):
    pacer = Pacer(ratio)
    pacer.wait_until(3.0, clock_line)
    for cycle in range(1, 101):
        pacer.wait_until(3.0 + 0.02 * cycle, clock_line)
    # The clock's sums of floats are exact to some 1e-13.
    assert clock_line.now_s == pytest.approx(50.0 + 2.0 / ratio, abs=1e-9)
    assert pacer.worst_late_s == pytest.approx(0.0, abs=1e-9)


def test_pacer_tells_lateness_and_catches_up(clock_line):
    pacer = Pacer(1.0)
    pacer.wait_until(0.0, clock_line)
    clock_line.now_s += 0.25
    pacer.wait_until(0.1, clock_line)
    assert pacer.late_s == pytest.approx(0.15)
    pacer.wait_until(1.0, clock_line)
    assert clock_line.now_s == pytest.approx(51.0)
    assert pacer.late_s == pytest.approx(0.0, abs=1e-9)
    assert pacer.worst_late_s == pytest.approx(0.15)


def test_pacer_looks_during_a_long_wait(clock_line):
    pacer = Pacer(1e-6)
    pacer.wait_until(0.0, clock_line)
    with pytest.raises(EndedError):
        pacer.wait_until(0.01, clock_line, ended_at(10))
    assert clock_line.now_s < 52.0


@pytest.mark.parametrize("ratio", [0.0, -1.0, float("inf"), float("nan")])
def test_pacer_refuses_a_ratio_without_meaning(ratio):
    with pytest.raises(UsageError, match="real-time ratio"):
        Pacer(ratio)


def test_every_line_is_a_line(tmp_path):
    lines: list[Line] = [NullLine(), FileLine(tmp_path / "raw"), PtyLine()]
    for line in lines:
        line.write(b"x")
        line.service()
        line.close()
        assert line.ledger.sent == 1
