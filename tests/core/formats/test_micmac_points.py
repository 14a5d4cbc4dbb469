"""Surveyed points for MicMac, where XML and text lie side by side."""

from pathlib import Path

from core.formats.exchange import ExchangeBlock, ExchangePoint
from core.formats.micmac import read_micmac, write_micmac


def test_names_with_blanks_do_not_come_back_twice__law(tmp_path: Path) -> None:
    points = {
        name: ExchangePoint(name, (1.0, 2.0, 3.0), (0.1, 0.1, 0.2))
        for name in ("church spire", "4711")
    }
    write_micmac(tmp_path, ExchangeBlock(points=points))
    assert read_micmac(tmp_path).points == points
