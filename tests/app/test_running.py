"""A run begun from a page: what it tells, and how it ends."""

import pytest

from app.running import Running, Telling
from core.errors import Cancelled


def told(running: Running, *messages: dict) -> dict:
    for message in messages:
        running.tell(message)
    return running.status()


def test_a_line_for_each_stage_with_what_was_said__truth(tmp_path):
    running = Running(tmp_path)
    voice = Telling(running.tell)
    voice.stage("scans", "").report(1, 4, "a.tif")
    first = running.status()["lines"][0]
    assert (first["stage"], first["share"], first["what"], first["pass"]) == (
        "scans", 0.25, "a.tif", 1,
    )  # fmt: skip
    assert first["left"] >= 0
    voice.ended("scans", "", 1.23, "6 scans")
    voice.stage("ties", "")
    voice.ended("ties", "", 2.0, "9 ties")
    voice.stage("ties", "")
    voice.say("A remark.")
    status = running.status()
    assert [(line["stage"], line["pass"]) for line in status["lines"]] == [
        ("scans", 1),
        ("ties", 1),
        ("ties", 2),
    ]
    assert (status["lines"][0]["seconds"], status["lines"][0]["said"]) == (1.23, "6 scans")
    assert "begun" not in str(status["lines"])
    assert status["log"] == ["A remark."]


def test_little_done_says_nothing_of_what_is_left__law(tmp_path):
    status = told(
        Running(tmp_path),
        {"event": "stage", "stage": "scans"},
        {"event": "progress", "stage": "scans", "done": 1, "total": 100, "what": ""},
    )
    assert status["lines"][0]["left"] is None


def test_a_run_that_was_asked_to_stop_stops_at_its_next_word__law(tmp_path):
    running = Running(tmp_path)
    running.cancel()
    with pytest.raises(Cancelled):
        running.tell({"event": "stage", "stage": "scans"})


def test_a_run_that_was_asked_to_stop_says_so_until_it_has__truth(tiny_block, tmp_path):
    import shutil

    folder = tmp_path / "block"
    shutil.copytree(tiny_block, folder)
    running = Running(folder)
    assert not running.status()["cancelling"]
    running.start()
    running.cancel()
    status = running.status()
    assert status["cancelling"] == (status["state"] == "running")
    running.close()
    assert not running.status()["cancelling"]


def test_a_block_that_cannot_be_read_fails_with_its_words__truth(tmp_path):
    running = Running(tmp_path)
    running.start()
    running.close()
    status = running.status()
    assert status["state"] == "failed"
    assert "block.toml" in status["why"]
    assert not running.gone_through.is_set()


def test_a_run_that_is_cancelled_at_once_can_go_on__truth(tiny_block, tmp_path):
    import shutil

    folder = tmp_path / "block"
    shutil.copytree(tiny_block, folder)
    running = Running(folder)
    running.start()
    running.cancel()
    running.close()
    assert running.status()["state"] == "cancelled"
