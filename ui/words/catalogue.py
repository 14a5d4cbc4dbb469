"""The texts of the desk in every language: read once, found by key, filled with values."""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from core.quality.rules import CLASSES, SENTENCES

FOLDER = Path(__file__).parent
LANGUAGES: tuple[str, ...] = ("en", "cs")
"""Languages with a table `LANGUAGE.toml`; the first is used where nothing else is asked for."""
KEYS: tuple[tuple[str, str], ...] = (
    ("Y", "act.accept"), ("N", "act.reject"), ("M", "act.dubious"), ("V", "act.invisible"),
    ("U", "act.undo"), ("Shift+U", "act.redo"), ("J", "act.next"), ("K", "act.previous"),
    ("C", "act.role"), ("Enter", "act.refine"), ("Esc", "draft.drop"), ("Space", "blink"),
    ("R", "raw"), ("L", "likeness"), ("P", "act.add"), ("B", "quality"),
    ("I", "board"), ("G", "placement"), ("+ \u2212", "zoom"), ("F", "act.fit"), ("H", "act.help"),
)  # fmt: skip
"""Every key of the desk with the text of what it does."""


@cache
def words(language: str = LANGUAGES[0]) -> Mapping[str, str]:
    """All texts of a language by key, with `{places}` for values."""
    assert language in LANGUAGES, f"no texts in {language}"
    table = tomllib.loads((FOLDER / f"{language}.toml").read_text(encoding="utf-8"))
    # The English sentences of a verdict belong to the rules: the report prints them too.
    verdict = {f"verdict.{kind}": text for kind, text in SENTENCES.items()}
    classes = {f"class.{name}": text for name, text in CLASSES.items()}
    return {**verdict, **classes, **table}


def preferred_language(accepted: str) -> str:
    """The language of ours that a browser likes best.

    Args:
        accepted: Its header `Accept-Language`, such as `cs-CZ,cs;q=0.9,en;q=0.8`.
    """
    best, most = LANGUAGES[0], 0.0
    for choice in accepted.split(","):
        tag, _, weight = choice.partition(";")
        language = tag.strip().lower().partition("-")[0]
        liking = _weight(weight)
        if language in LANGUAGES and liking > most:
            best, most = language, liking
    return best


def _weight(text: str) -> float:
    """The number of `q=0.8`; 1 where none is given, 0 where it cannot be read."""
    if not text.strip():
        return 1.0
    try:
        return float(text.strip().removeprefix("q="))
    except ValueError:
        return 0.0
