"""Completion of verbs, options and folders in a shell."""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import shtab

from app.arguments import FOLDERS
from app.cli import parser
from app.terminal import Voice
from ui.words.catalogue import LANGUAGES


def completion(given: argparse.Namespace, voice: Voice) -> None:
    """A script for a shell; it is a file for another program, so nothing translates or wraps it."""
    top = parser(given.language or LANGUAGES[0])
    for action in arguments_of(top):
        if action.type is Path:
            kind = shtab.DIRECTORY if action.metavar in FOLDERS else shtab.FILE
            action.complete = kind  # pyright: ignore[reportAttributeAccessIssue]
    sys.stdout.write(shtab.complete(top, given.shell, root_prefix="gruber") + "\n")


def arguments_of(known: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Every argument of a parser and of its verbs."""
    for action in known._actions:  # pyright: ignore[reportPrivateUsage]
        yield action
        if action.nargs == argparse.PARSER and isinstance(action.choices, dict):
            for verb in action.choices.values():
                yield from arguments_of(verb)
