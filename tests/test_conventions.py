"""The page of conventions is what the code says."""

from dataclasses import fields

import pytest

from core.formats.exchange import ExchangeFormat
from core.formats.exchange_formats import FORMATS
from tests.conventions import PAGE, page


def test_the_page_is_what_the_code_says__law() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m tests.conventions"


@pytest.mark.parametrize("one", FORMATS.values(), ids=lambda one: one.name)
def test_every_format_says_how_it_counts__law(one: ExchangeFormat) -> None:
    assert all(getattr(one.conventions, field.name) for field in fields(one.conventions))
    assert one.read or one.write
    assert one.default_name or one.write is None
    assert FORMATS[one.name] is one


def test_no_format_overwrites_the_export_of_another__law() -> None:
    names = [one.default_name for one in FORMATS.values() if one.write is not None]
    assert len({*names}) == len(names), sorted(name for name in names if names.count(name) > 1)
