"""The accuracy report in a browser: nothing is cut, neither on the screen nor on paper."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio
from affine import Affine

from app.report.model import ReportContent, Written
from app.report.page import write_report
from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.raster.ortho import open_ortho
from sessions.decisions import Accept, Recorded
from tests.browser.printed import pages_of
from tests.flights import FlightPlan, fly

A4_PX = 703
"""Width of A4 within its margins, pixels."""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The report of a block whose scans have names as long as those of the archive."""
    block = fly(FlightPlan(ties=200, control=24, check=1), np.random.default_rng(3)).block
    names = {name: f"LMSA08.1938.SYNT25.{name.replace('_', '')}" for name in block.photos}
    photos = {names[name]: replace(p, photo_id=names[name]) for name, p in block.photos.items()}
    measured = [
        replace(item, photo_id=names[item.photo_id]) for item in block.measurements.values()
    ]
    block = replace(
        block,
        photos=photos,
        measurements={item.key: item for item in measured},
        ties=replace(block.ties, photo_ids=tuple(names[n] for n in block.ties.photo_ids)),
    )
    adjusted = adjust_block(block)
    ahead = influence_of(adjusted, AdjustmentOptions())
    folder = tmp_path_factory.mktemp("report")
    mosaic, profile = folder / "mosaic.tif", {"count": 1, "dtype": "uint8", "crs": block.crs}
    placed = Affine(2, 0, -577000, 0, -2, -1193000)
    with rasterio.open(mosaic, "w", "GTiff", 300, 200, transform=placed, **profile) as file:
        file.write(np.full((1, 200, 300), 90, np.uint8))
    ortho = open_ortho([mosaic], block.crs)
    decided = [
        Recorded(number, "2026-01-02T10:00:00", "marian", Accept(*key))
        for number, key in enumerate([*block.measurements] * 9, start=1)
    ][:150]
    content = ReportContent(
        "long</style>", adjusted, before=block, influence=ahead, mosaic=mosaic, ortho=ortho,
        decisions=decided, written=Written("2026-01-02 10:00 UTC", "marian", "0.1.0"),
    )  # fmt: skip
    return write_report(folder, content)[0]


def test_the_mosaic_is_drawn_aside_over_the_ortho__truth(chromium, report):
    page = chromium.new_page(viewport={"width": 1366, "height": 900})
    page.goto(report.as_uri())
    front = page.locator(".swipe > div")
    front.scroll_into_view_if_needed()
    whole, before = page.locator(".swipe").bounding_box(), front.bounding_box()
    corner = before["x"] + before["width"] - 6, before["y"] + before["height"] - 4
    page.mouse.move(*corner)
    page.mouse.down()
    page.mouse.move(corner[0] - 200, corner[1], steps=5)
    page.mouse.up()
    after = front.bounding_box()
    assert after["width"] == pytest.approx(before["width"] - 200, abs=2)
    assert after["height"] == pytest.approx(whole["height"] - 2, abs=1)
    # The picture stays where it is: only more or less of it is seen.
    assert page.locator(".swipe svg").bounding_box()["width"] == pytest.approx(
        whole["width"] - 2, abs=1
    )
    page.close()


@pytest.mark.parametrize("width", [1366, 1600])
def test_no_table_is_wider_than_the_page__truth(chromium, report, width):
    """Of the table of exterior orientations sigma kappa was scrolled away."""
    page = chromium.new_page(viewport={"width": width, "height": 900})
    page.goto(report.as_uri())
    wide = (
        "[...document.querySelectorAll('.scroll')].filter(e => e.scrollWidth > e.clientWidth + 1)"
    )
    assert page.evaluate(f"{wide}.length") == 0
    assert page.evaluate("document.querySelectorAll('.scroll').length") > 8
    page.close()


def test_no_table_is_cut_on_paper__truth(chromium, report):
    page = chromium.new_page(viewport={"width": A4_PX, "height": 1000})
    page.goto(report.as_uri())
    page.emulate_media(media="print")
    rights = "[...document.querySelectorAll('table')].map(e => e.getBoundingClientRect().right)"
    assert page.evaluate(f"Math.max(...{rights})") <= A4_PX + 1
    # The first page holds all of the front: 269 mm of it are printed on.
    assert page.evaluate("document.querySelector('.front').getBoundingClientRect().bottom") < 1017
    page.close()


def test_a_printed_report_has_numbered_pages_and_heads_on_each__truth(chromium, report):
    page = chromium.new_page(viewport={"width": A4_PX, "height": 1000})
    page.goto(report.as_uri())
    titles = page.evaluate("[...document.querySelectorAll('h2, h3')].map(e => e.textContent)")
    pages = pages_of(page.pdf(format="A4", prefer_css_page_size=True))
    page.close()
    for number, text in enumerate(pages, start=1):
        assert f"{number} / {len(pages)}" in text
        assert "long</style> · 2026-01-02 10:00 UTC" in text
    rows = [text for text in pages if "2026-01-02 10:00marian" in text]
    assert len(rows) > 3
    assert all("No.UTCWhoDecision" in text for text in rows)
    # No heading is the last of its page.
    ends = ["".join(text.split()) for text in pages]
    assert not [one for one in titles if any(text.endswith("".join(one.split())) for text in ends)]
