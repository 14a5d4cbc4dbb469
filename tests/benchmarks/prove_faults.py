"""Faults planted in mosaics: are they among the twenty worst places, and does a click lead there?

Run: python -m tests.benchmarks.prove_faults [--seeds N ...] [--keep FOLDER]

One tiny synthetic block for each seed, run once. In copies of it one fault at a time is planted:
a photo 3 m off; a tie group measured 5 m off in one photo; a spike of the DEM; a seam through a
house; a road that is shown twice, because the photo beside it is off about there. Orthos, mosaic
and places are made by the program, and the desk is asked as a reviewer would: its list, and what a
click on the place tells. Printed: a row for each kind of fault; and of blocks without one, places
called off. Ends with 1 when fewer than nine in ten are found.
"""

import argparse
import io
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio.raw
import rasterio
import shapely
from scipy import ndimage

from app.mosaic import kept_orthos, make_mosaic, seam_guides
from app.orthos import make_orthos
from app.project import read_project
from app.run import Run, RunOptions
from app.terminal import JsonLines
from core.adjustment.adjusted import AdjustmentReport
from core.block import TiePoints
from core.control.stage import adjusted_without_gross
from core.matching.reference import level_of, open_heights
from core.mosaic.seam_edits import SeamArea
from core.progress import SILENT
from core.raster.grid import Grid
from core.synthetic.archive import make_block
from core.synthetic.flight import make_flight
from core.synthetic.landscape import make_landscape
from core.synthetic.options import CRS, SyntheticOptions
from sessions.session import Session
from tests.benchmarks.loop_hand import LoopHand

SEEDS = (961, 962, 963, 964, 965, 966, 967)
TOLD = 20
OFF_M = 3.0
TIES_OFF_M, TIES_RADIUS_M = 5.0, 150.0
SPIKE_M, SPIKE_CELLS = (15.0, 40.0), 3
DOUBLE_M, DOUBLE_RADIUS_M = 6.0, 90.0
NEAREST = 8
"""A house or road is drawn among so many nearest to a seam."""
Place = tuple[float, float]


@dataclass(frozen=True)
class Planted:
    """What was planted, and what a click has to lead to."""

    kinds: tuple[str, ...]
    """Kinds of place that lead to the cause."""
    photos: frozenset[str]
    """One of them must be named by the place, and be told of by the click."""
    place: Place | None = None
    """Where; None for a whole photo."""
    radius_m: float = 0.0


@dataclass
class Copy:
    """A copy of a block that a fault is planted in."""

    folder: Path
    rng: np.random.Generator
    session: Session

    def __post_init__(self) -> None:
        self.project = read_project(self.folder)
        self.report: AdjustmentReport = self.session.products.latest_value("adjustment")
        self.mosaic = self.session.products.latest_value("mosaic")

    def dem(self) -> Any:
        given = Run(self.project, self.session, JsonLines(io.StringIO()), RunOptions()).given
        bounds = self.report.block.search_bounds
        return open_heights(given.reference, level_of(self.report.block)).cropped(bounds)

    def rectify(self, report: AdjustmentReport) -> None:
        """The orthos of an adjustment, as a remake at the desk makes them."""
        make_orthos(self.session, self.project, report.block, self.dem(), SILENT)

    def remake(self, report: AdjustmentReport) -> None:
        """The mosaic, and all that is told of it."""
        orthos = kept_orthos(self.session, self.mosaic)
        mosaic = make_mosaic(self.session, self.project, orthos, SILENT)
        products = self.session.products
        products.save_value("adjustment", products.digest_of("planted"), report)
        walk = Run(self.project, self.session, JsonLines(io.StringIO()), RunOptions(workers=1))
        walk.stand_in(report, mosaic, {})
        with closing(walk.threads):
            walk.content(SILENT)

    def drawn(self, rows: list[Any]) -> Any:
        return rows[int(self.rng.integers(len(rows)))]

    def pairs(self) -> list[tuple[str, str, Any]]:
        """Photos that both show what lies about a seam, and that seam."""
        seams = self.mosaic.seams
        found = [
            (one.photo_id, other.photo_id, one.area.intersection(other.area))
            for at, one in enumerate(seams)
            for other in seams[at + 1 :]
        ]
        return [(one, other, line) for one, other, line in found if line.length > 200]

    def shown_by(self, name: str) -> Any:
        """Ground that an ortho covers, less its rim."""
        ortho = next(o for o in kept_orthos(self.session, self.mosaic) if o.photo_id == name)
        return shapely.box(*ortho.grid.bounds).buffer(-150)


def photo_off(copy: Copy) -> Planted:
    """One photo's orientation moved, as a wrong decision moves it."""
    name = copy.drawn([seam.photo_id for seam in copy.mosaic.seams if seam.area.area > 1e5])
    turn = copy.rng.uniform(0, 2 * np.pi)
    photo, block = copy.report.block.photos[name], copy.report.block
    centre = photo.exterior.centre + OFF_M * np.array([np.cos(turn), np.sin(turn), 0.0])
    moved = replace(photo, exterior=replace(photo.exterior, centre=centre))
    report = replace(copy.report, block=block.with_photos({**block.photos, name: moved}))
    copy.rectify(report)
    copy.remake(report)
    return Planted(("reference", "seam", "ties"), frozenset([name]))


def wrong_ties(copy: Copy) -> Planted:
    """All ties of one photo about a place measured the same way off; then adjusted again."""
    block = copy.report.block
    ties, positions = block.ties, copy.report.tie_positions
    name = copy.drawn([seam.photo_id for seam in copy.mosaic.seams if seam.area.area > 1e5])
    own = np.flatnonzero(ties.photo == ties.photo_ids.index(name))
    own = own[np.isfinite(positions[ties.point[own], 0])]
    seen = positions[ties.point[own], :2]
    centre = seen[int(copy.rng.integers(len(own)))]
    group = own[np.hypot(*(seen - centre).T) < TIES_RADIUS_M]
    turn = copy.rng.uniform(0, 2 * np.pi)
    per_m = 1 / block.photos[name].ground_pixel_m(block.camera_of(name))
    pixels = ties.pixels.copy()
    pixels[group] += TIES_OFF_M * per_m * np.array([np.cos(turn), np.sin(turn)])
    wrong = TiePoints(ties.photo_ids, ties.point, ties.photo, pixels, ties.sigma_px)
    run = Run(copy.project, copy.session, JsonLines(io.StringIO()), RunOptions())
    report = adjusted_without_gross(replace(block, ties=wrong), run.given.adjustment)
    copy.rectify(report)
    copy.remake(report)
    return Planted(("ties",), frozenset([name]), tuple(centre), 2 * TIES_RADIUS_M)


def dem_spike(copy: Copy) -> Planted:
    """Some cells of the DEM raised or lowered where that displaces the ground."""
    seams, (low, high) = copy.mosaic.seams, SPIKE_M
    while True:
        seam = copy.drawn(list(seams))
        west, south, east, north = seam.area.bounds
        place = copy.rng.uniform((west, south), (east, north))
        centre = copy.report.block.photos[seam.photo_id].exterior.centre
        height = copy.rng.uniform(low, high) * copy.rng.choice([-1, 1])
        away = abs(height) * np.hypot(*(place - centre[:2])) / (centre[2] - 250.0)
        if seam.area.buffer(-20).contains(shapely.Point(place)) and away > OFF_M:
            break
    with rasterio.open(copy.folder / "dem.tif", "r+") as file:
        values, (row, column) = file.read(1), file.index(*place)
        half = SPIKE_CELLS // 2
        values[row - half : row + half + 1, column - half : column + half + 1] += height
        file.write(values, 1)
    copy.rectify(copy.report)
    copy.remake(copy.report)
    return Planted(("ground",), frozenset([seam.photo_id]), tuple(place), 25.0)


def cut_house(copy: Copy) -> Planted | None:
    """A seam led through the middle of a house, by an edit; None where no two photos show one."""
    houses = seam_guides(copy.project, copy.mosaic.grid.bounds).buildings
    parts = {seam.photo_id: seam.area for seam in copy.mosaic.seams}
    found = [
        (house.distance(area.boundary), house, own, other)
        for own, area in parts.items()
        for other in parts
        if other != own
        for house in houses
        if area.contains(house) and copy.shown_by(other).contains(house)
    ]
    if not found:
        return None
    _, house, own, other = copy.drawn(sorted(found, key=lambda row: row[0])[:NEAREST])
    x, y = house.centroid.coords[0]
    ring = ((x, y - 40), (x + 60, y - 40), (x + 60, y + 40), (x, y + 40))
    copy.session.record(SeamArea(other, ring))
    copy.remake(copy.report)
    return Planted(("house",), frozenset([own, other]), (x, y), 15.0)


def double_road(copy: Copy) -> Planted:
    """A road beside a seam, and the photo on its other side off across it about there."""
    lines = seam_guides(copy.project, copy.mosaic.grid.bounds).roads
    found = []
    for one, other, line in copy.pairs():
        both = copy.shown_by(one).intersection(copy.shown_by(other))
        parts = {seam.photo_id: seam.area for seam in copy.mosaic.seams}
        for road in lines:
            middle = road.interpolate(0.5, normalized=True)
            own = next((n for n in (one, other) if parts[n].contains(middle)), None)
            if own is not None and road.length > 120 and both.contains(middle):
                found.append((middle.distance(line), road, own, other if own == one else one))
    _, road, own, other = copy.drawn(sorted(found, key=lambda row: row[0])[:NEAREST])
    middle = road.interpolate(0.5, normalized=True)
    at = road.project(middle)
    ahead, behind = (np.array(road.interpolate(at + d).coords[0]) for d in (20, -20))
    along = (ahead - behind) / np.hypot(*(ahead - behind))
    across, place = np.array([-along[1], along[0]]), np.array(middle.coords[0])
    _warp(copy, other, place, DOUBLE_M * across)
    ends = [place + 75 * way * along for way in (-1, 1)]
    # The program led the seam round what does not fit: one photo about there, then half the other.
    for photo, low in ((own, -60), (other, 0)):
        ring = [end + low * across for end in ends] + [end + 60 * across for end in ends[::-1]]
        copy.session.record(SeamArea(photo, tuple((float(x), float(y)) for x, y in ring)))
    copy.remake(copy.report)
    return Planted(("seam",), frozenset([own, other]), tuple(place), 150.0)


def _warp(copy: Copy, name: str, place: np.ndarray, shift: np.ndarray) -> None:
    """Move what an ortho shows about a place, less the further off."""
    ortho = next(o for o in kept_orthos(copy.session, copy.mosaic) if o.photo_id == name)
    grid: Grid = ortho.grid
    with rasterio.open(ortho.path, "r+") as file:
        values = file.read(1)
        east, north = (axis.ravel() for axis in grid.centres())
        away = np.hypot(*np.meshgrid(east - place[0], north - place[1]))
        weight = np.exp(-0.5 * (away / DOUBLE_RADIUS_M) ** 4) / grid.ground_sample_distance_m
        rows, columns = np.indices(values.shape, dtype=np.float64)
        moved = ndimage.map_coordinates(
            values, [rows + weight * shift[1], columns - weight * shift[0]], order=1, mode="nearest"
        )
        file.write(moved.astype(values.dtype), 1)


FAULTS: dict[str, Callable[[Copy], Planted | None]] = {
    "photo 3 m off": photo_off,
    "wrong tie group": wrong_ties,
    "DEM spike": dem_spike,
    "seam through a house": cut_house,
    "double road": double_road,
}


@dataclass(frozen=True)
class Found:
    """What the desk says of a planted fault."""

    rank: int
    """Place in the list that leads to the cause, 1 the worst; 0 where none of the first does."""
    clicks: int
    """How many clicks tell of the photo: 2 where it is the second of two; 0 where none does."""
    beside: int
    """First place of the list that is near and of the photo, whatever its kind; 0 for none."""
    listed: tuple[tuple[str, float, bool], ...]


def ask_desk(folder: Path, fault: Planted) -> Found:
    """Look through the list as a reviewer does, and click."""
    hand = LoopHand(folder, "reviewer")
    try:
        hand.send("sheet", sheet="mosaic", shown=True)
        hand.until(lambda parts: parts.get("mosaic", {}).get("version"))
        places = hand.parts["mosaic"]["misfits"][:TOLD]
        near = [number for number, one in enumerate(places, 1) if is_near(one, fault)]
        right = [number for number in near if clicks_to(places[number - 1], fault)]
        clicks = 0
        if right:
            one = places[right[0] - 1]
            wanted = clicks_to(one, fault)
            photo = one["photos"][wanted - 1]
            hand.send("pick", place=one["place"], photo=photo, number=71)
            hand.until(lambda parts: (parts.get("picked") or {}).get("number") == 71)
            clicks = wanted * (hand.parts["picked"]["photo"] == photo)
    finally:
        hand.close()
    listed = tuple((one["kind"], one["length"], one["significant"]) for one in places)
    return Found(right[0] if right else 0, clicks, near[0] if near else 0, listed)


def clicks_to(one: dict[str, Any], fault: Planted) -> int:
    """How many clicks open the photo at fault: 2 for the second of two; 0 where none does."""
    found = (at for at, name in enumerate(one["photos"], 1) if name in fault.photos)
    return next(found, 0) if one["kind"] in fault.kinds else 0


def is_near(one: dict[str, Any], fault: Planted) -> bool:
    east, north = one["place"]
    near = fault.place is None or np.hypot(east - fault.place[0], north - fault.place[1])
    return bool(set(one["photos"]) & fault.photos) and (near is True or near <= fault.radius_m)


def ready(folder: Path, seed: int) -> None:
    """A block that was run, with its houses as a layer, and the mosaic that avoids them."""
    options = SyntheticOptions("tiny", seed=seed)
    if not (folder / "results/mosaic.tif").is_file():
        make_block(folder, options)
        subprocess.run([sys.executable, "-m", "gruber", "run", str(folder)], check=True,
                       capture_output=True)  # fmt: skip
    if (folder / "buildings.gpkg").is_file():
        return
    flight = make_flight(options)
    landscape = make_landscape(options, flight.terrain, flight.bounds)
    houses = landscape.scene(True, Grid.over(flight.bounds, options.scale.texture_m)).houses
    outlines = shapely.to_wkb([shapely.Polygon(house.corners) for house in houses])
    pyogrio.raw.write(
        folder / "buildings.gpkg", np.array(outlines, dtype=object), [], np.array([], dtype=object),
        driver="GPKG", geometry_type="Polygon", crs=CRS,
    )  # fmt: skip
    text = (folder / "block.toml").read_text(encoding="utf-8")
    text = text.replace('dem = "dem.tif"', 'dem = "dem.tif"\nbuildings = "buildings.gpkg"')
    (folder / "block.toml").write_text(text, encoding="utf-8")
    with Session.open(folder, "benchmark") as session:
        copy = Copy(folder, np.random.default_rng(0), session)
        copy.remake(copy.report)


def main() -> int:
    """Plant each fault once in the block of every seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    rows: dict[str, list[Found]] = {name: [] for name in FAULTS}
    sound: list[int] = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in given.seeds:
            block = (given.keep or Path(scratch)) / f"b{seed}"
            ready(block, seed)
            none = ask_desk(block, Planted((), frozenset()))
            sound.append(sum(significant for _, _, significant in none.listed))
            sys.stderr.write(f"{seed}: sound {none.listed}\n")
            for number, (name, plant) in enumerate(FAULTS.items()):
                folder = Path(scratch) / f"{seed}-{number}"
                shutil.copytree(block, folder)
                with Session.open(folder, "benchmark") as session:
                    fault = plant(Copy(folder, np.random.default_rng((seed, number)), session))
                if fault is not None:
                    rows[name].append(ask_desk(folder, fault))
                    sys.stderr.write(f"{seed} {name}: {fault} {rows[name][-1]}\n")
                shutil.rmtree(folder)
    tell(rows, sound)
    found = [one.clicks > 0 for every in rows.values() for one in every]
    return 0 if sum(found) >= 0.9 * len(found) else 1


def tell(rows: dict[str, list[Found]], sound: list[int]) -> None:
    """The table: a row for each kind of fault, and one for blocks in which none was planted."""
    sys.stdout.write(
        "| fault | planted | led to its cause | of these by a second click | place in the list "
        "| only near it |\n"
        "|---|---|---|---|---|---|\n"
    )
    for name, every in rows.items():
        ranks = ", ".join(str(one.rank or "–") for one in every)
        led, second = (sum(one.clicks >= least for one in every) for least in (1, 2))
        near = sum(not one.rank and one.beside > 0 for one in every)
        sys.stdout.write(f"| {name} | {len(every)} | {led} | {second} | {ranks} | {near} |\n")
    sys.stdout.write(
        f"| none: places called off | 0 | {sum(sound)} in {len(sound)} blocks | | | |\n"
    )


if __name__ == "__main__":
    sys.exit(main())
