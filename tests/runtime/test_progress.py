"""Progress without a terminal: lines that say how far, how fast and how long."""

import pytest

from uniart_jax.runtime import progress


def test_what_is_tracked_comes_through_and_the_end_is_told(capsys):
    assert list(progress.track(iter("abc"), "letters", 3, unit="letters")) == ["a", "b", "c"]
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1  # the interval has not passed
    assert lines[0].startswith("letters: 3 of 3  ") and lines[0].endswith("letters/s  ETA 0:00:00")


def test_rate_and_remaining_time_leave_out_what_was_there_before(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[0])
    with progress.advancing("prepare", 100, done=60) as advance:
        for _ in range(10):
            now[0] += 4
            advance()
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["prepare: 68 of 100  0.25 objects/s  ETA 0:02:08"]


def test_on_a_terminal_there_is_a_bar(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    assert list(progress.track(range(4), "letters", 4, unit="letters")) == [0, 1, 2, 3]
    shown = capsys.readouterr().err
    assert "4/4" in shown and "letters/s" in shown and "ETA" in shown


def test_what_is_being_done_is_said_in_a_file_too(capsys):
    with progress.working(progress.messages(), "loading") as say:
        say("a.png: structure [1]")
        say("a.png: structure [1]")
        say("a.png: parts")
    lines = ["· loading", "· a.png: structure [1]", "· a.png: parts"]
    assert capsys.readouterr().err.splitlines() == lines


def test_what_is_being_done_is_one_line_on_a_terminal(capsys):
    console = progress.messages(force_terminal=True, width=80)
    with progress.working(console, "loading [1]") as say:
        say("a.png: [b] parts")
        console.print("made")
    shown = capsys.readouterr().err
    assert "a.png: [b] parts" in shown and "\x1b[" in shown and "· " not in shown


def test_quiet_says_nothing_of_what_is_being_done(capsys):
    progress.be_quiet()
    try:
        with progress.working(progress.messages(), "loading") as say:
            say("structure")
    finally:
        progress.be_quiet(False)
    assert capsys.readouterr().err == ""


def test_durations():
    assert progress.duration(99.6) == "0:01:40" and progress.duration(-3) == "0:00:00"
    assert progress.duration(2 * 86400 + 3661) == "2 days, 1:01:01"


def test_nothing_to_do_says_nothing(capsys):
    with progress.advancing("prepare", 5, done=5):
        pass
    assert list(progress.track([], "nothing", 0)) == []
    assert capsys.readouterr().err == ""


@pytest.fixture(autouse=True)
def no_terminal(monkeypatch):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.delenv("TTY_COMPATIBLE", raising=False)
