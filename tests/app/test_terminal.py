"""How work shows itself: lines for people, JSON for machines."""

import io
import json
import subprocess
import sys

import pytest
from rich.console import Console

import app.terminal
from app.terminal import JsonLines, Terminal
from core.errors import ScanError
from core.progress import Progress
from sessions.codec import from_json, to_json

ERROR = ScanError("a.tif", "it is cut off.", "Scan it again.")


def terminal(is_terminal: bool) -> tuple[Terminal, io.StringIO]:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=is_terminal, width=100, highlight=False)
    return Terminal(console), stream


def test_elsewhere_than_on_a_terminal_a_stage_is_one_plain_line__truth():
    voice, stream = terminal(False)
    progress = voice.stage("ties", "Tie points between the scans")
    assert isinstance(progress, Progress)
    for done in range(50):
        progress.report(done, 50, "1938_014")
    voice.ended("ties", "Tie points between the scans", 12.34, "[654] tie points")
    assert stream.getvalue() == "Tie points between the scans         12.3 s  [654] tie points\n"


def test_on_a_terminal_the_bar_leaves_nothing_behind_but_the_line__truth():
    voice, stream = terminal(True)
    voice.stage("ties", "Tie points").report(0, 0)
    voice.ended("ties", "Tie points", 1.0, "none")
    assert voice.bars is None
    assert stream.getvalue().rstrip().endswith("none")


def test_whatever_happens_the_terminal_is_left_as_it_was__law():
    voice, stream = terminal(True)
    voice.stage("ties", "Tie points")
    voice.close()
    voice.close()
    assert stream.getvalue().endswith("\x1b[?25h") or "\x1b[?25h" in stream.getvalue()
    voice.failed(ERROR)
    assert "cut off" not in stream.getvalue()  # the command line tells it, once


def test_every_line_for_machines_is_one_json_object__truth(monkeypatch):
    clock = iter([10.0, 10.4, 11.2, 11.3])
    monkeypatch.setattr(app.terminal.time, "monotonic", lambda: next(clock))
    stream = io.StringIO()
    voice = JsonLines(stream)
    progress = voice.stage("ties", "Tie points")
    assert isinstance(progress, Progress)
    for done in range(4):
        progress.report(done, 4, "Příbram")
    voice.ended("ties", "Tie points", 1.2345, "3 tie points")
    voice.say("done")
    voice.failed(ERROR)
    voice.close()
    events = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert [event["event"] for event in events] == [
        *("stage", "progress", "progress", "done", "message", "error"),
    ]
    # At most one a second.
    assert [event["done"] for event in events if event["event"] == "progress"] == [0, 2]
    assert events[1]["what"] == "Příbram"
    assert events[3] == {"event": "done", "stage": "ties", "seconds": 1.23, "said": "3 tie points"}
    assert events[5] == {
        "event": "error",
        "file": "a.tif",
        "cause": "it is cut off.",
        "remedy": "Scan it again.",
        "told": to_json(ERROR.told),
    }
    assert from_json(events[5]["told"]).template == ERROR.told.template


@pytest.mark.parametrize("voice", ["Terminal", "JsonLines"])
def test_work_goes_on_when_nobody_reads_any_more__law(voice):
    code = (
        "import sys, app.terminal\n"
        f"voice = app.terminal.{voice}()\n"
        "voice.say('first')\n"
        "sys.stdin.readline()\n"
        "voice.say('second')\n"
        "voice.say('third')\n"
        "sys.stderr.write('went on')\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        assert "first" in process.stdout.readline()
        process.stdout.close()
        process.stdin.write("closed\n")
        process.stdin.close()
        assert process.stderr.read() == "went on"
    assert process.returncode == 0
