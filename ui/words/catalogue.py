"""The texts of Gruber in every language: read once, found by key, filled with values."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from core.quality.sentences import CLASSES, SENTENCES
from core.said import ENGLISH_SIGNS, Said, Signs, Wording, english_form

FOLDER = Path(__file__).parent
LANGUAGES: tuple[str, ...] = ("en", "cs")
"""Languages with a table `LANGUAGE.toml`; the first is used where nothing else is asked for."""
SIGNS: Mapping[str, Signs] = {
    "en": ENGLISH_SIGNS,
    "cs": str.maketrans({".": ",", ",": "\u202f", "-": "\u2212"}),
}
"""How each language writes numbers."""
MESSAGES = "messages"
"""Other languages than the first have a table `messages.LANGUAGE.toml` as well: what the engine
says, by the English sentence."""
KEYS: tuple[tuple[str, str], ...] = (
    ("Y", "act.accept"), ("N", "act.reject"), ("M", "act.dubious"), ("V", "act.invisible"),
    ("Shift+Y", "act.accept-all"),
    ("U", "act.undo"), ("Shift+U", "act.redo"), ("J", "act.next"), ("K", "act.previous"),
    ("A", "queue.all"),
    ("C", "act.role"), ("Enter", "act.refine"), ("Esc", "draft.drop"), ("Space", "blink"),
    ("R", "raw"), ("L", "likeness"), ("O", "edges"), ("T", "flicker"),
    ("Z", "together"), ("P", "act.add"), ("B", "quality"), ("Shift+B", "checks"),
    ("I", "board"), ("Shift+I", "mask"), ("G", "placement"), ("Shift+G", "placing"),
    ("Shift+O", "mosaic"), ("X", "grow"),
    (".", "details"), ("+ \u2212", "zoom"), ("F", "act.fit"), ("Shift+F", "act.area"),
    ("H", "act.help"),
)  # fmt: skip
"""Every key of the desk with the text of what it does."""


MOMENT = re.compile(r"(\d{4})-(\d\d)-(\d\d)[T ](\d\d:\d\d)(?::\d\d(?:\.\d+)?(?:\+00:00)?)?( UTC|)")
"""A time as it is kept, or already shortened for a reader."""


@cache
def words(language: str = LANGUAGES[0]) -> Mapping[str, str]:
    """All texts of a language by key, with `{places}` for values."""
    assert language in LANGUAGES, f"no texts in {language}"
    # The English sentences of a verdict belong to the rules: the report prints them too.
    verdict = {f"verdict.{kind}": text for kind, text in SENTENCES.items()}
    classes = {f"class.{name}": text for name, text in CLASSES.items()}
    return {**verdict, **classes, **_table(f"{language}.toml")}


@cache
def messages(language: str) -> Mapping[str, str]:
    """What the engine says, in a language, by the English sentence; none for English itself."""
    if language == LANGUAGES[0]:
        return {}
    ours = words(language)
    verdict = {text: ours[f"verdict.{kind}"] for kind, text in SENTENCES.items()}
    classes = {text: ours[f"class.{name}"] for name, text in CLASSES.items()}
    return {**verdict, **classes, **_table(f"{MESSAGES}.{language}.toml")}


@cache
def lesson_words(language: str) -> Mapping[str, str]:
    """The texts of all lessons by key: `lesson.NAME.` and what the lesson calls it."""
    return dict(_leaves(_table(f"lessons.{language}.toml"), "lesson"))


def _leaves(table: Mapping[str, Any], before: str) -> Iterator[tuple[str, str]]:
    """Texts of nested tables, each under the names of its tables with a dot between them."""
    for name, inside in table.items():
        if isinstance(inside, str):
            yield f"{before}.{name}", inside
        else:
            yield from _leaves(inside, f"{before}.{name}")


def _table(name: str) -> Mapping[str, Any]:
    return tomllib.loads((FOLDER / name).read_text(encoding="utf-8"))


class Teller:
    """Tells every text in one language."""

    def __init__(self, language: str = LANGUAGES[0]) -> None:
        self.language = language
        self._words, self._messages = words(language), messages(language)
        self._wording = Wording(FORMS[language], SIGNS[language], self.again)

    def __call__(self, key: str, /, **values: Any) -> str:
        """A text of the catalogue with its places filled."""
        told = {
            name: self.moment(one)
            if isinstance(one, str) and not isinstance(one, Said) and MOMENT.fullmatch(one)
            else one
            for name, one in values.items()
        }
        return self._wording.told(self._words[key], told)

    def moment(self, text: str) -> str:
        """A time such as `2026-11-26T03:12:07.250+00:00` as the language writes it."""
        found = MOMENT.fullmatch(text)
        if found is None:
            return text
        year, month, day, clock, rest = found.groups()
        czech = f"{int(day)}.\u00a0{int(month)}.\u00a0{year} {clock}"
        return (czech if self.language == "cs" else f"{year}-{month}-{day} {clock}") + rest

    def again(self, message: str) -> str:
        """What the engine said; in English where it was kept by an earlier version."""
        if not isinstance(message, Said):
            return self._messages.get(message, message)
        template = self._messages.get(message.template, message.template)
        return self._wording.told(template, message.values)

    def number(self, value: float | None, spec: str = "") -> str:
        """A number as the language writes it; a dash where there is none."""
        return "\u2013" if value is None else self._wording.number(value, spec)


def czech_form(number: int) -> int:
    """One; two, three and four; all others."""
    return 0 if number == 1 else 1 if 2 <= number <= 4 else 2


FORMS = {"en": english_form, "cs": czech_form}
"""Which of a noun's forms goes with a whole number, by language."""


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
