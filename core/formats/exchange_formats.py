"""Every format that `gruber export` and `gruber import` know, by its name."""

from collections.abc import Mapping

from core.formats.exchange import ExchangeFormat
from core.formats.micmac import MICMAC

FORMATS: Mapping[str, ExchangeFormat] = {
    one.name: one
    for one in (
        MICMAC,
    )
}  # fmt: skip
"""By the name that `--to` and `--from` take."""
