"""Answers of the command line to what an import asks: how a list is to be read."""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import get_args

from core.errors import ProjectError
from core.formats.eo_format import EO_FORMATS
from core.formats.eo_list import ANSWERED
from core.formats.measurement_list import COLUMNS, MEASUREMENTS, MeasurementReading, Origin

WHERE = "--answer"
"""The option whose errors these are."""


def parted(answer: str, names: Collection[str]) -> tuple[str, str]:
    """What an answer is about, and what it says.

    Raises:
        ProjectError: It is about nothing that is asked.
    """
    name, said, value = answer.partition("=")
    if said and name in names:
        return name, value
    raise ProjectError(
        WHERE,
        "{answer!r} answers nothing.",
        "Write one of {names}, an equals sign and the answer.",
        answer=answer,
        names=list(names),
    )


def named_columns(value: str, known: Collection[str]) -> tuple[str, ...]:
    """What columns hold, from the first on; empty ones are not read.

    Raises:
        ProjectError: A word is no column.
    """
    columns = tuple(part.strip() for part in value.split(","))
    wrong = [column for column in columns if column and column not in known]
    if wrong:
        raise ProjectError(
            WHERE,
            "{wrong!r} is no column.",
            "Name them in their order, of {names}.",
            wrong=wrong[0],
            names=list(known),
        )
    return columns


def positive(name: str, value: str) -> float:
    """A standard deviation.

    Raises:
        ProjectError: It is no number above nought.
    """
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not 0 < number < math.inf:
        raise ProjectError(
            WHERE, "{name} is {value!r}.", "Give a number above 0.", name=name, value=value
        )
    return number


def measurement_reading(answers: Sequence[str]) -> MeasurementReading:
    """How a list of measurements is to be read, from words such as `origin=middle`.

    Raises:
        ProjectError: A word answers nothing that is asked, or not in a way there is.
    """
    reading = MeasurementReading()
    for answer in answers:
        match parted(answer, ("columns", "origin", "sigma")):
            case "columns", value:
                reading = replace(reading, columns=named_columns(value, COLUMNS))
            case "origin", "corner" | "middle" as origin:
                reading = replace(reading, origin=origin)
            case "sigma", value:
                reading = replace(reading, sigma_px=positive("sigma", value))
            case _, value:
                raise ProjectError(
                    WHERE,
                    "{value!r} is no origin of pixels.",
                    "It is one of {names}.",
                    value=value,
                    names=list(get_args(Origin)),
                )
    return reading


def eo_heads(name: str, answers: Sequence[str]) -> tuple[str, ...]:
    """The columns of a list of orientations; empty where the list says them.

    Raises:
        ProjectError: A word answers nothing, or the format asks nothing.
    """
    asked = ("columns",) if name in {form.name for form in EO_FORMATS} else ()
    heads: tuple[str, ...] = ()
    for answer in answers:
        if not asked:
            raise ProjectError(WHERE, "{name} asks nothing.", "Leave the answer out.", name=name)
        heads = named_columns(parted(answer, asked)[1], ANSWERED)
    return heads


def check_answers(name: str, answers: Sequence[str]) -> None:
    """Refuse what answers nothing of a format, before anything is read.

    Raises:
        ProjectError: As the readings above.
    """
    if name == MEASUREMENTS.name:
        measurement_reading(answers)
    else:
        eo_heads(name, answers)
