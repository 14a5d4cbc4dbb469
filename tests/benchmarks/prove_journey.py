"""A real block from an empty folder to its report, in a browser, without terminal or editor.

Run: python -m tests.benchmarks.prove_journey vovcha|ngi --pictures FOLDER [--data FOLDER]
[--block FOLDER]

Files are dropped on the start page as a hand drops them, the form is filled in, the block is run,
ten points are judged by what the desk says of them, and the report is opened. Printed: clicks,
drags and keys (each letter typed is one), seconds of each step, and what the report says. A
picture is taken of every step.
"""

import argparse
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from playwright.sync_api import Page, expect

from sessions.session import Session
from tests.benchmarks.desk_browser import browser
from tests.browser.hands import gone_on
from tests.journeys.copies import reviewing
from tests.real.blocks import write_blurred_positions

SIZE = {"width": 1600, "height": 1000}
RUN_MS = 1_800_000
JUDGED = 10
WRITTEN = """() => {
  const { remaking, stale, written } = gruber.parts.status;
  return !remaking && written && !stale.length;
}"""
DOUBTED_SIGMA = 3.0
"""A misfit from here on is rejected, as an operator would who looks no further."""


@dataclass
class Hand:
    """An operator at a page: what was done, and a picture of each step."""

    page: Page
    pictures: Path
    clicks: int = 0
    drags: int = 0
    keys: int = 0
    steps: list[tuple[str, float]] = field(default_factory=list)
    since: float = field(default_factory=time.perf_counter)

    def click(self, selector: str) -> None:
        self.page.click(selector)
        self.clicks += 1

    def press(self, key: str) -> None:
        self.page.keyboard.press(key)
        self.keys += 1

    def type(self, selector: str, text: str) -> None:
        """Into a field that is clicked first; what stands in it is overwritten."""
        self.click(selector)
        self.press("Control+a")
        self.page.keyboard.type(text)
        self.keys += len(text)

    def choose(self, selector: str, value: str) -> None:
        self.page.select_option(selector, value)
        self.clicks += 2

    def drop(self, *paths: Path) -> None:
        """Drag files or folders from the computer onto the page."""
        box = self.page.locator("#drop").bounding_box()
        assert box
        place = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
        data = {"items": [], "files": [str(path) for path in paths], "dragOperationsMask": 1}
        tools = self.page.context.new_cdp_session(self.page)
        for kind in ("dragEnter", "dragOver", "drop"):
            tools.send("Input.dispatchDragEvent", {"type": kind, "data": data, **place})
        tools.detach()
        self.drags += 1

    def done(self, step: str) -> None:
        """The step is over: its time is noted and the page pictured."""
        now = time.perf_counter()
        self.steps.append((step, now - self.since))
        name = f"{len(self.steps):02d}-{step.replace(' ', '-')}.png"
        self.page.screenshot(path=self.pictures / name)
        self.since = time.perf_counter()


def vovcha_files(data: Path, _: Path) -> list[Path]:
    """What lies in the archive's folder, as it is there, except `block.toml` and the truth."""
    folder = data / "vovcha-film"
    return [folder / name for name in ("scans", "ortho", "roads", "dem.tif", "footprints.gpkg")]


def ngi_files(data: Path, folder: Path) -> list[Path]:
    """Frames, Sentinel-2 and DEM, with positions blurred by 200 m; an operator sorts them so."""
    source = data / "ngi-baviaanskloof"
    for kind, files in {
        "scans": sorted((source / "frames").glob("*RGB.tif")),
        "ortho": [source / "reference" / "sentinel2_b432_byte.tif"],
    }.items():
        (folder / kind).mkdir()
        for file in files:
            shutil.copy(file, folder / kind)
    shutil.copy(source / "frames" / "dem.tif", folder)
    write_blurred_positions(data, folder / "eo.csv", seed=2, blur_m=200.0)
    return sorted(folder.iterdir())


def fill_vovcha(hand: Hand, data: Path) -> None:
    hand.type("#field-camera-film-principal_distance_mm", "151.92")
    hand.type("#field-camera-film-frame_mm", "180, 180")
    hand.type("#field-camera-film-fiducials_mm", "1 -84 84\n2 84 84\n3 84 -84\n4 -84 -84")
    hand.type("#field-scans-scan_pixel_um", "45")


def fill_ngi(hand: Hand, data: Path) -> None:
    crs = (data / "ngi-baviaanskloof/io/ngi_xyz_opk.prj").read_text(encoding="utf-8").strip()
    hand.type("#field-block-crs", crs)
    hand.type("#field-camera-film-principal_distance_mm", "120")
    hand.type("#field-camera-film-frame_mm", "92.16, 165.888")
    hand.type("#field-scans-scan_pixel_um", "144")
    hand.choose("#field-scans-georeference", "none")
    for table in ("scans", "ortho"):
        fold = f"details:has(> .field > [id^='field-{table}-'])"
        if hand.page.get_attribute(fold, "open") is None:
            hand.click(f"{fold} > summary")
    hand.type("#field-scans-exterior", "eo.csv")
    hand.type("#field-reference-ortho_sigma_m", "5")
    hand.type("#field-reference-dem_sigma_m", "5")
    hand.type("#field-ortho-gsd_m", "5")


BLOCKS = {"vovcha": (vovcha_files, fill_vovcha), "ngi": (ngi_files, fill_ngi)}


def judge(hand: Hand) -> None:
    """Ten points: what lies beyond three sigma is rejected, the rest is accepted."""
    page = hand.page
    for _ in range(JUDGED):
        page.wait_for_function("gruber.compareState().drawn.whole")
        key, ratio = page.evaluate(
            "[gruber.parts.point.key.join('|'), gruber.parts.point.figures.ratio]"
        )
        hand.press("n" if (ratio or 0) > DOUBTED_SIGMA else "y")
        gone_on(page, key)
    page.wait_for_function("!gruber.parts.status.adjusting")


def begin(hand: Hand, name: str, data: Path, source: Path) -> None:
    """From the empty folder to the desk."""
    page, (files, fill) = hand.page, BLOCKS[name]
    page.wait_for_selector("#drop")
    hand.done("empty folder")
    hand.drop(*files(data, source))
    expect(page.locator(".thumb")).not_to_have_count(0, timeout=RUN_MS)
    page.wait_for_selector(".upload", state="detached", timeout=RUN_MS)
    hand.done("files dropped")
    fill(hand, data)
    page.wait_for_selector('[data-act="placing.run"]:not(:disabled)')
    hand.done("form filled in")
    hand.click('[data-act="placing.run"]')
    page.wait_for_selector(".stage.now")
    hand.done("run begun")
    page.wait_for_selector("#queue .row.current", timeout=RUN_MS)
    hand.done("desk open")


def end(hand: Hand) -> str:
    """Ten points judged, the report opened: what its first page says."""
    hand.press("Escape")  # the tour of a first visit
    judge(hand)
    hand.done("ten points judged")
    hand.click('[data-act="remake"]')
    hand.page.wait_for_function(WRITTEN, timeout=RUN_MS)
    hand.done("orthos updated")
    hand.click("#results-open")
    hand.page.wait_for_selector("#results[open]")
    hand.done("results")
    with hand.page.context.expect_page() as shown:
        hand.click('#results a[href$="report.html"]')
    hand.page = shown.value
    hand.page.wait_for_load_state()
    hand.done("report")
    return hand.page.locator("table").first.inner_text()


def journey(name: str, data: Path, pictures: Path, kept_in: Path | None) -> int:
    """The whole way; the number of decisions that came into the session."""
    with tempfile.TemporaryDirectory() as made, browser() as chromium:
        folder, source = kept_in or Path(made) / name, Path(made) / "source"
        folder.mkdir()
        source.mkdir()
        with reviewing(folder) as url:
            page = chromium.new_context(viewport=SIZE, bypass_csp=True).new_page()
            page.set_default_timeout(60_000)
            page.goto(url)
            hand = Hand(page, pictures)
            begin(hand, name, data, source)
            said = end(hand)
        with Session.open(folder, "reader") as session:
            kept = len(session.decisions())
    sys.stdout.write(f"{said}\n")
    for step, seconds in hand.steps:
        sys.stdout.write(f"{step:20s} {seconds:7.1f} s\n")
    sys.stdout.write(
        f"{name}: {hand.clicks} clicks, {hand.drags} drags, {hand.keys} keys; "
        f"{kept} decisions in the session\n"
    )
    return kept


def main() -> None:
    """One block; ends with an error where a decision did not come into the session."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", choices=sorted(BLOCKS))
    parser.add_argument("--pictures", type=Path, required=True)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--block", type=Path, help="a folder to be made; stays afterwards")
    given = parser.parse_args()
    given.pictures.mkdir(parents=True, exist_ok=True)
    if journey(given.name, given.data, given.pictures, given.block) != JUDGED:
        sys.exit("not every verdict came into the session")


if __name__ == "__main__":
    main()
