"""Every format that `gruber export` and `gruber import` know, by its name."""

from collections.abc import Mapping

from core.formats.eo_format import EO_FORMATS
from core.formats.exchange import ExchangeFormat
from core.formats.ign_opk import OPK_FORMAT
from core.formats.micmac import MICMAC

FORMATS: Mapping[str, ExchangeFormat] = {
    one.name: one
    for one in (
        MICMAC,
        *EO_FORMATS,
        OPK_FORMAT,
    )
}  # fmt: skip
"""By the name that `--to` and `--from` take."""
