"""Help and error messages of the command line, in the operator's language."""

import argparse
from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Any

from ui.words.catalogue import LANGUAGES, Teller

OPTION = "--language"
ARGPARSE = (
    "usage: ",
    "options",
    "positional arguments",
    "show this help message and exit",
    "%(prog)s: error: %(message)s\n",
    "argument %(argument_name)s: %(message)s",
    "the following arguments are required: %s",
    "unrecognized arguments: %s",
    "expected one argument",
    "invalid choice: %(value)r (choose from %(choices)s)",
)
"""What argparse says itself, word for word, as far as it is told in other languages."""


class Parser(argparse.ArgumentParser):
    """A parser of arguments whose help is told in one language."""

    def __init__(self, tell: Teller, **how: Any) -> None:
        """A parser.

        Args:
            tell: The language.
            how: What any parser takes.
        """
        self.tell = tell
        raw = argparse.RawDescriptionHelpFormatter
        super().__init__(**how, formatter_class=raw)

    def add_argument(self, *names: str, **how: Any) -> argparse.Action:
        """One argument; its help is given in English."""
        if isinstance(how.get("help"), str):
            how["help"] = self.tell.again(how["help"])
        return super().add_argument(*names, **how)

    def add_option(self, written: str, told: str, **how: Any) -> None:
        """One option with a value, such as `--out PATH`; None is its value when left out."""
        name, metavar = written.split()
        self.add_argument(name, metavar=metavar, help=told, **how)

    def add_switch(self, name: str, told: str, default: object = False) -> None:
        """One option that is given or not."""
        self.add_argument(name, action="store_true", default=default, help=told)


@dataclass(frozen=True, slots=True)
class Verbs:
    """The verbs of a command as they are added."""

    tell: Teller
    """The language of their help."""
    added: Any
    """What `add_subparsers` returns; argparse keeps the name of its type to itself."""

    def add(self, name: str, summary: str, examples: dict[str, str]) -> Parser:
        """One verb with its help: a sentence, and examples with what they do."""
        again, width = self.tell.again, max(len(example) for example in examples)
        lines = [f"  {example:<{width}}   {again(does)}" for example, does in examples.items()]
        told = again(summary)
        return self.added.add_parser(
            name,
            tell=self.tell,
            help=told,
            description=f"{told[0].upper()}{told[1:]}.",
            epilog="\n".join([again("examples:"), *lines]),
        )


def asked_language(arguments: Sequence[str]) -> str:
    """The language that arguments ask for, before they are parsed; English where none is known."""
    asked = [LANGUAGES[0]]
    for word, following in zip(arguments, [*arguments[1:], ""], strict=False):
        name, given, value = word.partition("=")
        asked += [value if given else following] * (name == OPTION)
    return asked[-1] if asked[-1] in LANGUAGES else LANGUAGES[0]


def asked_verb(arguments: Sequence[str], verbs: Container[str]) -> str:
    """The first argument that is a verb; empty without one."""
    return next((word for word in arguments if word in verbs), "")


def teller_of_usage(language: str) -> Teller:
    """Tells in a language; from now on argparse does as well."""
    tell = Teller(language)
    # argparse looks its own words up in gettext, whose tables are files of another kind.
    argparse.__dict__["_"] = tell.again
    return tell
