"""A sentence with its figures: written in English, kept so that it can be shown in any language.

A place is written `{name}` or, with a format, `{name:.2f}`. A place that is counted names its
forms, with `#` for the number: `{count:# scan|# scans}`.
"""

import re
import string
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast
from unicodedata import category

import numpy as np

NUMERAL = re.compile(r"[+-]?\d+(?:\.\d+)?")
Signs = Mapping[int, str]
"""How a language writes point, comma and minus of a number, as `str.maketrans` makes it."""
ENGLISH_SIGNS: Signs = str.maketrans({",": "\u202f", "-": "\u2212"})


class Said(str):
    """A finished English sentence that still knows its template and its figures."""

    __slots__ = ("template", "values")
    template: str
    """The sentence with its places; by it other languages know it."""
    values: Mapping[str, Any]
    """What stands in its places: numbers, names, other sentences."""

    def __new__(cls, template: str, values: Mapping[str, Any]) -> "Said":
        """The sentence, told in English."""
        plain = {name: _plain(value) for name, value in values.items()}
        made = super().__new__(cls, ENGLISH.told(template, plain))
        made.template, made.values = template, plain
        return made

    def __reduce__(self) -> tuple[type["Said"], tuple[str, Mapping[str, Any]]]:
        """Copied and pickled as it was made."""
        return type(self), (self.template, self.values)


def _plain(value: Any) -> Any:
    """What can be kept in a file: numbers, texts and lists of them; all else as text."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(one) for one in cast("Sequence[Any]", value)]
    if isinstance(value, Said | int | float):
        return value
    return one_line(str(value))


# design: the longest path of a usual system is shown whole in its beginning and its end.
LONGEST = 500
"""Characters of a text that stands in a sentence."""


def one_line(text: str) -> str:
    """A text from outside as it may stand in a sentence: without control signs, and not endless."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"
    if text.isprintable():
        return text
    return "".join(repr(sign)[1:-1] if category(sign) in HIDDEN else sign for sign in text)


HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Kinds of signs that show nothing, or move what stands around them."""


def say(template: str, /, **values: Any) -> Said:
    """A sentence with its figures.

    Args:
        template: The English sentence, written out in one piece.
        values: What stands in its places.
    """
    return Said(template, values)


class Wording(string.Formatter):
    """How a language fills the places of a sentence."""

    def __init__(
        self,
        form: Callable[[int], int],
        signs: Signs = ENGLISH_SIGNS,
        again: Callable[[str], str] = str,
    ) -> None:
        """A language.

        Args:
            form: Which of a noun's forms goes with a whole number.
            signs: How it writes numbers.
            again: Tells a sentence that stands in another one.
        """
        self._form, self._signs, self._again = form, signs, again

    def told(self, template: str, values: Mapping[str, Any]) -> str:
        """A template with its places filled."""
        return self.vformat(template, (), values)

    def number(self, value: float, spec: str = "") -> str:
        """A number as the language writes it."""
        return format(value, spec).translate(self._signs)

    def format_field(self, value: Any, format_spec: str) -> str:
        """One place."""
        if "|" in format_spec:
            return self._counted(value, format_spec.split("|"))
        if isinstance(value, str):
            if NUMERAL.fullmatch(value) is None:
                return format(self._again(value), format_spec)
            spelt = format(float(value), format_spec) if format_spec else value
            return spelt.translate(self._signs)
        if isinstance(value, list | tuple):
            several = cast("Sequence[Any]", value)
            return ", ".join(self.format_field(one, format_spec) for one in several)
        return self.number(value, format_spec)

    def _counted(self, value: Any, forms: Sequence[str]) -> str:
        number = self.format_field(value, "," if isinstance(value, int) else "")
        try:
            place = self._form(int(value))
        except ValueError:  # a fraction is counted as many
            place = len(forms) - 1
        return forms[min(place, len(forms) - 1)].replace("#", number)


def english_form(number: int) -> int:
    """One, and all others."""
    return int(number != 1)


ENGLISH = Wording(english_form)
