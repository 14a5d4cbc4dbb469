"""The rules of a job as a TOML file: read into `JobRules`, and written with every limit in it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from app.block_schema import Key, Unit
from app.block_toml import Document, FieldError, Table
from core.errors import ProjectError
from core.quality.job_rules import (
    AUTHORITIES,
    LIMITS,
    USUAL_RULES,
    JobRules,
    out_of_order,
    set_by_job,
)
from core.said import say

KEYS = {
    name: Key(name, "number", getattr(USUAL_RULES, name), unit=Unit(one.unit, one.low, one.high))
    for name, one in LIMITS.items()
}
"""The limits as keys of the file."""


def read_rules(file: Path | None) -> JobRules:
    """Limits of a job; those that the file leaves out are those of the standards.

    Args:
        file: The file; None where the job sets no limits.

    Raises:
        ProjectError: It cannot be read, or says something that no limit can be.
    """
    if file is None:
        return USUAL_RULES
    document = Document(file)
    if not document.values:
        # The shell empties a file before the limits that were in it are read and printed into it.
        remedy = "Set one in it (gruber check rules prints all), or take `rules` out of block.toml."
        raise ProjectError(file, "holds no limit.", remedy)
    try:
        table = Table(document, "", document.values, KEYS)
        rules = JobRules(**{name: _value(table, name) for name in KEYS})
        contrary = out_of_order(rules)
        if contrary is not None:
            low, high = contrary
            cause = say(
                "{first} is {low:g}, more than {second} ({high:g}).",
                first=low, second=high, low=getattr(rules, low), high=getattr(rules, high),
            )  # fmt: skip
            given = low if table.has(low) else high
            raise table.error(given, cause, "Set both so that they fit each other.")
    except FieldError as error:
        # A form shows an error of a field beside it, and this file has none.
        raise ProjectError(error.file, error.cause, error.remedy) from error
    return rules


def rules_on_disk(block: Path) -> JobRules | None:
    """Limits of a block as its files have them now; None where they cannot be used.

    Args:
        block: Its block.toml.
    """
    try:
        return read_rules(Document(block).table("block").file("rules"))
    except ProjectError:
        return None


def _value(table: Table, name: str) -> Any:
    """One limit: a whole number where it counts something."""
    value = table.number(name)
    if not isinstance(getattr(USUAL_RULES, name), int):
        return value
    if value != int(value):
        told = say("must be a whole number, not {value:g}.", value=value)
        raise table.error(name, told, "Write it without a point.")
    return int(value)


def rules_lines(rules: JobRules) -> Iterator[str]:
    """The file of a job: every limit with what it is, its unit and who asks it, as TOML."""
    changed = set_by_job(rules)
    yield "# Rules of a job: limits by which blocks are judged. They steer no computation."
    yield '# block.toml names this file: [block] rules = "rules.toml".'
    yield "# A limit that is left out has its default."
    for name, limit in LIMITS.items():
        usual = getattr(USUAL_RULES, name)
        source = f"default {usual:g}, asked by: {AUTHORITIES[limit.source]}"
        words = limit.words[0].upper() + limit.words[1:]
        yield ""
        yield f"# {words}; {limit.unit}, {limit.low:g} to {limit.high:g}."
        yield f"# {'SET BY THE JOB; ' if name in changed else ''}{source}."
        yield f"{name} = {getattr(rules, name)!r}"
