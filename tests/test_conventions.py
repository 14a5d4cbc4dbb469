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
