"""Observers of known bias and scatter read places at the desk, in a Chromium: is it all recovered?

Run: python -m tests.benchmarks.prove_readings SEED... [--size tiny] [--keep FOLDER]

Six blocks of six seeds, each with a plan that is drawn before its control. The fifth is a strip of
eight photos, and no control is used that lies in its last four: neighbours across would hold a
single corner photo. The reference ortho of the sixth is shifted. Ada reads every
place by clicks on mosaic and reference, Bob ten of them. Where the mosaic truly shows the ground of
a place follows from the true orientation and height and from the block's own: that is what both
see, plus what is put in of bias and scatter. From another draw of places and scatter come as many
readings without a browser as make forty together with the six.

Printed: what was put in of the difference of both observers, and what is told of it with the 95 %
interval of so few readings; the same of its scatter; m_p of the mosaic as these observers see it in
the long run, everywhere between the places, and its interval by the readings. Of the fifth block
the photo of the worst place of its misfit map, and the one that truly is off most; of the sixth
what readings and what independent points tell. Ends with 1 where one figure of the desk in twenty
and more lies outside of its interval, m_p more than four times in forty, the worst place does not
lie in the free end, or nothing tells the shift.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import shapely
from scipy.special import chdtri, stdtrit

from app.check_plan import PlanWish, draw_plan
from app.project import described, read_project
from core.adjustment.adjusted import AdjustmentReport
from core.block import footprint
from core.matching.reference import level_of, open_heights
from core.mosaic.misfit import photos_shown
from core.quality.check_points import independent_checks
from core.quality.readings import PlanFigures, Reading, ReadingFigures, reading_figures
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions, seeded
from core.synthetic.truth import read_truth
from sessions.checks import checked_figures, standing_plans, version_on_disk
from sessions.decisions import Reject
from sessions.session import Session
from tests.benchmarks.control_blocks import quietly
from tests.benchmarks.desk_browser import browser, sit_down
from tests.benchmarks.prove_check_points import hidden_points, measure, write_list
from tests.browser.hands import PLACE, open_checks, read_place, sit_down_as
from tests.journeys.copies import reviewing

KINDS = ("plain", "plain", "plain", "plain", "free end", "shifted")
SHIFT_M = (2.0, -1.5)
"""The reference ortho of the shifted block lies so far off."""
STRIP, FREE = 8, 4
"""Photos of the strip with a free end, and those of its end without control."""
TOGETHER, ASKED = 40, 36
"""Readings of whole plans, and of how many m_p must lie within its interval."""
DOUBLED = 10
"""Places that Bob reads."""
STEPS = 6
"""Passes in which the ground under a ray is found; relief of a tenth of the height needs three."""
TAILS = np.array([0.025, 0.975])
Places = np.ndarray
Off = Callable[[Places], np.ndarray]


@dataclass(frozen=True)
class Observer:
    """Somebody who sees a place of the mosaic beside where it is, always and by chance."""

    name: str
    bias_m: tuple[float, float]
    scatter_m: float

    def sees(self, off: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """What is read where the mosaic is off by so much (n, 2), metres."""
        return off + self.bias_m + rng.normal(0, self.scatter_m, off.shape)


ADA, BOB = Observer("ada", (0.25, -0.15), 0.15), Observer("bob", (-0.20, 0.10), 0.25)
APART_M = np.subtract(ADA.bias_m, BOB.bias_m)
SCATTER_M = float(np.hypot(ADA.scatter_m, BOB.scatter_m))


class Shown:
    """Where the mosaic of a block truly shows the ground."""

    def __init__(self, folder: Path, reference_m: tuple[float, float]) -> None:
        """Read what was made.

        Args:
            folder: The block, run to its mosaic.
            reference_m: How far the reference shows the ground aside (east, north), metres.
        """
        files = described(read_project(folder)).reference
        with Session.open(folder, "prover") as session:
            report = session.products.latest_value("adjustment")
            self.seams = session.products.latest_value("mosaic").seams
        assert isinstance(report, AdjustmentReport)
        self.block, self.truth, self.reference_m = report.block, read_truth(folder), reference_m
        self.heights = open_heights(files, level_of(report.block))

    def off(self, places: Places) -> np.ndarray:
        """Mosaic minus reference (n, 2) at places of the reference, metres; NaN where it ends."""
        ground = places - self.reference_m
        true = np.column_stack([ground, np.full(len(ground), np.nan)])
        true[:, 2] = self.truth.heights_at(true)
        found = np.full((len(places), 2), np.nan)
        names = np.array(photos_shown(places, self.seams))
        for name in sorted(set(names.tolist()) & set(self.truth.photos)):
            chosen = (names == name) & np.isfinite(true).all(axis=1)
            pixels = self.truth.photos[name].pixel_from_object(true[chosen], self.truth.camera)
            shown = places[chosen]
            for _ in range(STEPS):
                heights = self.heights.heights(shown)
                photo, camera = self.block.photos[name], self.block.camera_of(name)
                shown = photo.object_from_pixel(pixels, heights, camera)[:, :2]
            found[chosen] = shown - places[chosen]
        return found

    def all_over(self) -> np.ndarray:
        """The same all over the mosaic, as readings of very many places would have it."""
        off = self.off(self._grid())
        return off[np.isfinite(off).all(axis=1)]

    def worst_photo(self) -> tuple[str, float]:
        """The photo whose part of the mosaic is off most, and its RMS, metres."""
        grid = self._grid()
        squares = np.sum(self.off(grid) ** 2, axis=1)
        names = np.array(photos_shown(grid, self.seams))
        rms = {
            name: float(np.sqrt(np.nanmean(squares[names == name]))) for name in self.block.photos
        }
        return max(rms.items(), key=lambda one: one[1])

    def _grid(self) -> Places:
        """Places over all of the mosaic."""
        west, south, east, north = shapely.union_all([seam.area for seam in self.seams]).bounds
        grid = np.stack(np.meshgrid(np.linspace(west, east, 80), np.linspace(south, north, 80)))
        return grid.reshape(2, -1).T


def made(folder: Path, kind: str, options: SyntheticOptions) -> None:
    """Make a block, draw its plan and run it."""
    if kind == "free end":
        options = replace(options, strips=1, photos_per_strip=STRIP)
    make_block(folder, options)
    if kind == "shifted":
        for sheet in sorted((folder / "ortho").glob("*.tif")):
            with rasterio.open(sheet, "r+") as raster:
                raster.transform = rasterio.Affine.translation(*SHIFT_M) @ raster.transform
        places = hidden_points(read_truth(folder), options.seed)
        write_list(folder / "points.csv", places, options.seed, {"check"})
        assert quietly("import", str(folder), "--from", "points", str(folder / "points.csv")) == 0
    assert quietly("run", str(folder), "--until", "georeference") in (0, 1)
    assert quietly("check", "plan", str(folder)) == 0
    assert quietly("run", str(folder)) in (0, 1)
    if kind == "shifted":
        measure(folder, read_truth(folder), places, options.seed).close()
        assert quietly("run", str(folder)) in (0, 1)
    if kind == "free end":
        withhold_control(folder)


def withhold_control(folder: Path) -> None:
    """Reject all control in the ground of the last photos, and run again."""
    with Session.open(folder, "withholder") as session:
        block = session.products.latest_value("adjustment").block
        photos = list(block.photos.values())[-FREE:]
        ground = shapely.union_all(
            [footprint(one, block.camera_of(one.photo_id)) for one in photos]
        )
        for point, photo in block.measurements:
            if shapely.contains_xy(ground, *block.surveyed[point].position[:2]):
                session.record(Reject(point, photo, "changed"))
    assert quietly("run", str(folder)) in (0, 1)


def read_at_the_desk(folder: Path, off: Off, rng: np.random.Generator) -> ReadingFigures:
    """Ada reads all places of the plan and Bob ten of them; the figures of it."""
    with reviewing(folder) as url, browser() as launched:
        for observer, most in ((ADA, None), (BOB, DOUBLED)):
            page = sit_down_as(sit_down(launched, url), observer.name)
            open_checks(page)
            total = sum(not one["after"] for one in places_of(page))
            for _ in range(most or total):
                seen = observer.sees(off(np.array([page.evaluate(PLACE)["at"]])), rng)[0]
                read_place(page, seen) if np.isfinite(seen).all() else pass_over(page)
            page.wait_for_function("!gruber.isAhead()")
            page.context.close()
    with Session.open(folder, "prover") as session:
        said = session.decisions()
        plan, version = standing_plans(said)[-1], version_on_disk(session.products)
        return checked_figures(said, plan, version)


def pass_over(page: Any) -> None:
    """No detail can be told at the current place; the next one follows."""
    name = page.evaluate(PLACE)["place"]
    page.keyboard.press("n")
    page.keyboard.press("1")
    page.wait_for_function("name => gruber.checksState().current !== name", arg=name)


def places_of(page: Any) -> list[dict[str, Any]]:
    """The places of the plan that is read."""
    return page.evaluate("gruber.checksState().found.places")


def read_without_desk(folder: Path, shown: Shown, seed: int) -> ReadingFigures:
    """Another draw of places, read by both observers as at the desk."""
    rng = seeded(seed, "readings")
    with Session.open(folder, "prover") as session:
        plan = draw_plan(read_project(folder), session, PlanWish(seed=seed)).plan
    drawn = [place for place in plan.places if not place.after]
    off = shown.off(np.array([(place.east, place.north) for place in drawn]))
    seen = np.isfinite(off).all(axis=1)
    readings = [
        Reading(place.place_id, observer.name, tuple(difference.tolist()))
        for observer, most in ((ADA, len(off)), (BOB, DOUBLED))
        for place, difference in list(
            zip(np.array(drawn)[seen], observer.sees(off[seen], rng), strict=True)
        )[:most]
    ]
    return reading_figures(readings, plan.count)


def long_run_m_p(off: np.ndarray, figures: ReadingFigures) -> float:
    """m_p of very many places, as many of them read by both as here, metres."""
    both = figures.doubled / figures.read
    alone = np.mean(np.sum((off + ADA.bias_m) ** 2, axis=1)) + 2 * ADA.scatter_m**2
    mean = np.add(ADA.bias_m, BOB.bias_m) / 2
    joint = np.mean(np.sum((off + mean) ** 2, axis=1)) + SCATTER_M**2 / 2
    return float(np.sqrt((1 - both) * alone + both * joint))


def recovered(figures: PlanFigures) -> list[tuple[str, float, float, float]]:
    """What was put in of two observers' differences: its name, put in, and the 95 % interval."""
    freedom = figures.count - 1
    rows = []
    for axis, name in enumerate(("east", "north")):
        mean, deviation = figures.mean_m[axis], figures.deviation_m[axis]
        half = stdtrit(freedom, TAILS[1]) * deviation / np.sqrt(figures.count)
        rows.append((f"bias {name}", float(APART_M[axis]), mean - half, mean + half))
        low, high = deviation * np.sqrt(freedom / chdtri(freedom, TAILS))
        rows.append((f"scatter {name}", SCATTER_M, float(low), float(high)))
    return rows


def within(value: float, interval: Sequence[float]) -> bool:
    return interval[0] <= value <= interval[1]


def told_of(folder: Path) -> dict[str, Any]:
    """The report on disk."""
    assert quietly("report", str(folder)) == 0
    return json.loads((folder / "results/report.json").read_text(encoding="utf-8"))


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


@dataclass
class Count:
    """How often a figure lay within its interval."""

    of: int = 0
    hits: int = 0

    def take(self, value: float, interval: Sequence[float]) -> str:
        """Count one figure; what the table says of it."""
        self.of, self.hits = self.of + 1, self.hits + within(value, interval)
        return f"{value:.2f} in {interval[0]:.2f} to {interval[1]:.2f}"


def prove(folder: Path, block: int, options: SyntheticOptions, counts: tuple[Count, Count]) -> bool:
    """One block: its lines of the table; whether what only its kind has is told."""
    (of_observers, of_m_p), kind = counts, KINDS[block]
    made(folder, kind, options)
    shown = Shown(folder, SHIFT_M if kind == "shifted" else (0.0, 0.0))
    everywhere = shown.all_over()
    figures = read_at_the_desk(folder, shown.off, seeded(options.seed, "observers"))
    (pair,) = figures.pairs
    told = [
        f"{name} {of_observers.take(value, (low, high))}"
        for name, value, low, high in recovered(pair.figures)
    ]
    rounds = TOGETHER * (block + 1) // len(KINDS) - of_m_p.of
    m_p = of_m_p.take(long_run_m_p(everywhere, figures), figures.together.m_p_interval)
    say(
        f"| {options.seed} {kind} | {figures.read}, {figures.doubled} | "
        f"{np.sqrt(np.mean(np.sum(everywhere**2, axis=1))):.2f} | {'; '.join(told)} | {m_p} |"
    )
    for number in range(1, rounds):
        other = read_without_desk(folder, shown, 100 * options.seed + number)
        of_m_p.take(long_run_m_p(everywhere, other), other.together.m_p_interval)
    return is_told(folder, kind, shown)


def is_told(folder: Path, kind: str, shown: Shown) -> bool:
    """Whether the worst place lies in the free end, and independent points tell the shift."""
    if kind == "plain":
        return True
    report = told_of(folder)
    if kind == "free end":
        worst, (name, rms) = report["misfit"]["places"][0], shown.worst_photo()
        there = np.hypot(*shown.off(np.array([worst["position"]]))[0])
        more = np.mean(np.hypot(*shown.all_over().T) > there)
        end = list(shown.block.photos)[-FREE:]
        say(
            f"Worst place of the misfit map: {worst['scan']}, {worst['length_m']:.2f} m, truly "
            f"{there:.2f} m; {more:.0%} of the mosaic is off more. Photos of the end: "
            f"{', '.join(end)}. Off most by the truth: {name}, RMS {rms:.2f} m."
        )
        return worst["scan"] in end
    with Session.open(folder, "prover") as session:
        adjusted = session.products.latest_value("adjustment")
    checks = independent_checks(adjusted)
    kinds = {one["kind"] for one in report["verdict"]}
    say(
        f"Shifted by {np.hypot(*SHIFT_M):.2f} m: {checks.count} independent points "
        f"{checks.fit_plan_m:.2f} m off, {checks.ratio:.1f} times what is predicted; "
        f"findings {', '.join(sorted(kinds))}."
    )
    return bool(kinds & {"checks-over", "checks-worse"})


def main() -> int:
    """A row for each seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--size", choices=("tiny", "small"), default="small")
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    say(
        "| seed | read, by both | mosaic m_p | observers | m_p of readings |\n|---|---|---|---|---|"
    )
    counts, sound = (Count(), Count()), True
    with tempfile.TemporaryDirectory() as temporary:
        for block, seed in enumerate(given.seeds[: len(KINDS)]):
            folder = (given.keep or Path(temporary)) / str(seed)
            sound &= prove(folder, block, SyntheticOptions(given.size, seed=seed), counts)
    observers, m_p = counts
    say(
        f"Observers: {observers.hits} of {observers.of} within. m_p: {m_p.hits} of {m_p.of} within."
    )
    few = observers.hits < observers.of - 1 - observers.of // 20
    return int(few or m_p.hits * TOGETHER < ASKED * m_p.of or not sound)


if __name__ == "__main__":
    sys.exit(main())
