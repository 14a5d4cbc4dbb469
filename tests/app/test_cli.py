"""The command line: verbs in, exit codes out."""

import json

import pytest

from app.cli import CANCELLED, DONE, UNUSABLE, main, parser
from core.errors import Cancelled, ScanError


def ends(monkeypatch, error: BaseException | None, *before: str) -> int:
    """Exit code of a run that ends with an error."""

    def run(given, voice):
        voice.stage("scans", "Scans")
        if error is not None:
            raise error

    monkeypatch.setattr("app.verbs.run.run", run)
    return main([*before, "run", "somewhere"])


def test_a_verb_that_ends_well_is_nought__law(monkeypatch):
    assert ends(monkeypatch, None) == DONE == 0


def test_data_that_cannot_be_used_is_one_message_and_code_one__law(monkeypatch, capsys):
    error = ScanError("a.tif", "it is cut off.", "Scan it again.")
    assert ends(monkeypatch, error) == UNUSABLE == 1
    assert capsys.readouterr().err == "gruber: a.tif: it is cut off. Scan it again.\n"


@pytest.mark.parametrize("error", [Cancelled(), KeyboardInterrupt()])
def test_cancelled_is_130_and_says_that_nothing_is_lost__law(monkeypatch, capsys, error):
    assert ends(monkeypatch, error) == CANCELLED == 130
    assert "goes on from here" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("verb", "kept"),
    [
        ("new", "nic nezůstalo napůl zapsané"),
        ("run", "stejný příkaz naváže"),
        ("review", "znovu otevře"),
    ],
)
def test_cancelled_says_what_is_kept_and_how_to_go_on__law(monkeypatch, capsys, verb, kept):
    def cancelled(given, voice):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"app.verbs.{verb}.{verb}", cancelled)
    assert main([verb, "somewhere", "--language", "cs"]) == CANCELLED
    told = capsys.readouterr().err
    assert kept in told
    assert told.count("\n") == 1


def test_a_broken_promise_of_our_own_is_no_message__law(monkeypatch):
    """Bugs are to be seen, not smoothed over."""
    with pytest.raises(ZeroDivisionError):
        ends(monkeypatch, ZeroDivisionError())


def test_machines_are_told_the_error_in_its_parts__law(monkeypatch, capsys):
    error = ScanError("a.tif", "it is cut off.", "Scan it again.")
    assert ends(monkeypatch, error, "--log-json") == UNUSABLE
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert told[-1]["event"] == "error"
    assert told[-1]["remedy"] == "Scan it again."


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["run", "--from", "nowhere"],
        ["run", "--workers", "0"],
        ["run", "--workers", "many"],
        ["run", "--from", "mosaic", "--until", "scans"],
        ["demo", "--size", "huge"],
        ["demo", "--epoch", "1900"],
        ["review", "--port", "70000"],
        ["new"],
    ],
)
def test_wrong_use_is_code_two__law(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert capsys.readouterr().err


def test_left_out_the_block_is_the_current_folder__law():
    for verb in ("run", "review", "report"):
        assert str(parser().parse_args([verb]).block) == "."
    assert parser().parse_args(["doctor"]).block is None


def test_the_block_of_an_experiment_is_named_as_any_other__law(monkeypatch):
    """`--block` is the form of earlier versions."""
    asked = []
    monkeypatch.setattr("app.verbs.teach.experiment", lambda _, folder, __: asked.append(folder))
    named = (["flight"], ["flight/block.toml"], ["--block", "flight"], [])
    for words in named:
        assert main(["teach", *words, "--experiment", "table-4"]) == DONE
    assert [str(folder) for folder in asked] == ["flight", "flight", "flight", "gruber-demo"]


def test_what_is_not_given_has_its_default__law():
    given = parser().parse_args(["demo"])
    assert (given.size, given.epoch, given.relief, given.seed) == ("small", 1938, 60.0, 1)
    assert str(given.out) == "gruber-demo"
    assert given.workers >= 1
    review = parser().parse_args(["review"])
    assert (review.port, review.host) == (8765, "127.0.0.1")
    assert review.operator
