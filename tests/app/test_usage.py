"""Help and wrong use in the operator's language."""

import argparse
import inspect

import pytest

from app.cli import main, parser
from app.usage import ARGPARSE, asked_language


@pytest.fixture(autouse=True)
def _english_again():
    yield
    parser()


@pytest.mark.parametrize(
    ("arguments", "language"),
    [
        ((), "en"),
        (("run", "--language", "cs"), "cs"),
        (("--language=cs", "run"), "cs"),
        (("--language=cs", "run", "--language", "en"), "en"),
        (("run", "--language"), "en"),
        (("run", "--language", "tlh"), "en"),
    ],
)
def test_the_language_is_known_before_arguments_are_parsed__truth(arguments, language):
    assert asked_language(arguments) == language


def test_argparse_says_these_words__oracle():
    """With other words in a later Python, their Czech would silently be English again."""
    source = inspect.getsource(argparse)
    assert [text for text in ARGPARSE if repr(text)[1:-1] not in source] == []


def test_no_help_of_a_verb_is_english_in_czech__law():
    english, czech = (parser(language) for language in ("en", "cs"))
    helps = [dict(texts_of(top)) for top in (english, czech)]
    assert helps[0].keys() == helps[1].keys()
    assert len(helps[0]) > 60
    assert [where for where, text in helps[0].items() if text == helps[1][where]] == []


def texts_of(top):
    """Descriptions and helps of a parser and of its verbs, by where they stand."""
    yield top.prog, top.description
    for action in top._actions:
        if action.help not in (None, argparse.SUPPRESS):
            yield f"{top.prog} {action.dest}", action.help
        if isinstance(action, argparse._SubParsersAction):
            yield from ((f"{top.prog}: {one.dest}", one.help) for one in action._choices_actions)
            for verb in action.choices.values():
                yield from texts_of(verb)


def test_wrong_use_is_told_in_czech__truth(capsys):
    for wrong, told in (
        (["run", "--until", "breakfast"], "nelze zvolit"),
        (["new"], "chybějí povinné argumenty: FOLDER"),
        (["run", "--from", "mosaic", "--until", "scans"], "předchází"),
    ):
        with pytest.raises(SystemExit) as ended:
            main([*wrong, "--language", "cs"])
        assert ended.value.code == 2
        assert told in capsys.readouterr().err
