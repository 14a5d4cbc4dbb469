"""Seams beside those midway between nadirs: how near they come to houses, how much they show.

Takes blocks that have been run. Houses are those of `[reference] buildings`; of a synthetic block
without any, those it was painted with. Both mosaics are composed of the same orthos with the same
tones. The difference across a seam is that of the two photos' corrected gray values, every metre of
it, mean of the absolute values: pixel by pixel, grain and all, and of means over squares of nine
pixels a side, which is what an eye sees as a jump; of the latter the 95th percentile as well. The
step is what the mosaic itself shows: from nine pixels a side just beyond the feather to as many on
the other side of the seam, less what the two photos show in the mean from there to there; mean and
95th percentile. Photos differ by themselves: the last figure is what the same measure gives there
where either photo alone is shown, without any seam.

Run: python -m tests.benchmarks.prove_seams BLOCK ... [--out FOLDER]
"""

import argparse
import json
import sys
import tempfile
from dataclasses import fields, replace
from pathlib import Path
from time import process_time

import cv2
import numpy as np
import rasterio
import shapely

from app.mosaic import film_planes, seam_guides
from app.project import Project, read_project
from core.mosaic.composition import MosaicOptions, MosaicProduct, compose_mosaic, mosaic_grid
from core.mosaic.drawing import FEATHER_PX
from core.mosaic.radiometry import Balance
from core.mosaic.seam_cut import BUILDING_M
from core.mosaic.seams import Seam
from core.orthos.rectification import OrthoProduct
from core.raster.grid import Grid
from core.synthetic.flight import make_flight
from core.synthetic.land_cover import make_houses
from core.synthetic.landscape import make_landscape
from core.synthetic.options import SyntheticOptions
from sessions.session import Session

MEAN_PX = 9
STEP_M = 1.0
"""Places along seams lie so far apart, metres."""

KINDS = {
    "nadir, feathered": MosaicOptions(seams_by_nadir=True, feather_only=True),
    "drawn, feathered": MosaicOptions(feather_only=True),
    "drawn": MosaicOptions(),
}


def main() -> None:
    """Compose each block in both ways and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("blocks", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, help="keep the mosaics here")
    asked = parser.parse_args()
    heads = ["block", "seams", "length m", "near houses", "difference", "of means", "95 %"]
    say("| " + " | ".join([*heads, "step", "95 %", "no seam", "s", "holes"]) + " |")
    say("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for folder in asked.blocks:
        with tempfile.TemporaryDirectory() as name:
            out = Path(name) if asked.out is None else asked.out
            out.mkdir(parents=True, exist_ok=True)
            prove(folder, out)


def prove(folder: Path, out: Path) -> None:
    """The rows of one block."""
    project = read_project(folder)
    with Session.open(folder, "benchmark") as session:
        names = [scan.photo_id for scan in project.scans.listed]
        kept = [session.products.latest_value(f"ortho/{name}") for name in names]
        orthos = [ortho for ortho in kept if ortho is not None]
        planes = film_planes(session, names)
    grid = mosaic_grid(orthos)
    guides = seam_guides(project, grid.bounds)
    if not guides.buildings:
        guides = replace(guides, buildings=painted_houses(project))
    near = shapely.union_all(shapely.buffer(np.array(guides.buildings, dtype=object), BUILDING_M))
    for kind, options in KINDS.items():
        paths = (out / f"{folder.name}-{kind}.tif", out / f"{folder.name}-{kind}.gpkg")
        started = process_time()
        made = compose_mosaic(orthos, grid, *paths, guides=guides, planes=planes, options=options)
        took = process_time() - started
        lines = borders(made.seams)
        houses = "-"
        if guides.buildings:
            houses = f"{lines.intersection(near).length / lines.length:.1%}"
        raw, jumps = (differences(made, orthos, side) for side in (1, MEAN_PX))
        left, alone = steps(made, orthos)
        say(
            f"| {folder.name} | {kind} | {lines.length:.0f} | {houses} "
            f"| {np.mean(raw):.2f} | {np.mean(jumps):.2f} | {np.percentile(jumps, 95):.2f} "
            f"| {np.mean(left):.2f} | {np.percentile(left, 95):.2f} | {np.mean(alone):.2f} "
            f"| {took:.1f} | {len(made.holes)} |"
        )


def painted_houses(project: Project) -> tuple[shapely.Polygon, ...]:
    """Houses of the archival epoch of a synthetic block; none of another."""
    truth = project.folder / "truth" / "truth.json"
    if not truth.is_file():
        return ()
    said = json.loads(truth.read_text(encoding="utf-8"))["args"]
    plain = {name: value for name, value in said.items() if isinstance(value, str | int | float)}
    if not plain.keys() <= {field.name for field in fields(SyntheticOptions)}:
        return ()
    options = SyntheticOptions(**plain)
    flight = make_flight(options)
    landscape = make_landscape(options, flight.terrain, flight.bounds)
    then, _ = make_houses(landscape.network, options.seed, options.recency)
    return tuple(shapely.Polygon(house.corners) for house in then)


def borders(seams: tuple[Seam, ...]) -> shapely.Geometry:
    """Where one photo gives way to another."""
    return shapely.union_all(
        [a.area.intersection(b.area) for k, a in enumerate(seams) for b in seams[:k]]
    )


def differences(made: MosaicProduct, orthos: list[OrthoProduct], side: int) -> np.ndarray:
    """Absolute differences of corrected gray across all seams, means over so many pixels."""
    by_name = {ortho.photo_id: ortho for ortho in orthos}
    found: list[np.ndarray] = []
    for k, a in enumerate(made.seams):
        for b in made.seams[:k]:
            line = a.area.intersection(b.area)
            pieces = [p for p in shapely.get_parts(line) if p.length > 0]
            for piece in pieces:
                along = np.arange(STEP_M / 2, piece.length, STEP_M)
                places = shapely.get_coordinates(shapely.line_interpolate_point(piece, along))
                grays = [
                    shown_at(by_name[s.photo_id], made.balances[s.photo_id], places, side)
                    for s in (a, b)
                ]
                found.append(np.abs(grays[0] - grays[1]))
    every = np.concatenate(found)
    return every[np.isfinite(every)]


def steps(made: MosaicProduct, orthos: list[OrthoProduct]) -> tuple[np.ndarray, np.ndarray]:
    """Absolute steps across all seams beyond the photos' mean: the mosaic's, and one photo's."""
    by_name = {ortho.photo_id: ortho for ortho in orthos}
    whole = OrthoProduct("mosaic", made.path, made.grid, 1.0, (0.0, 0.0))
    aside = (FEATHER_PX + MEAN_PX + 1) / 2 * made.grid.ground_sample_distance_m
    found: list[np.ndarray] = []
    alone: list[np.ndarray] = []
    for k, a in enumerate(made.seams):
        for b in made.seams[:k]:
            line = a.area.intersection(b.area)
            for piece in (p for p in shapely.get_parts(line) if p.length > 2 * STEP_M):
                along = np.arange(STEP_M, piece.length - STEP_M, STEP_M)
                ends = [
                    shapely.get_coordinates(shapely.line_interpolate_point(piece, along + d))
                    for d in (-STEP_M, STEP_M)
                ]
                course = ends[1] - ends[0]
                across = np.column_stack([-course[:, 1], course[:, 0]])
                across *= aside / np.maximum(np.hypot(*across.T), 1e-9)[:, None]
                middle = (ends[0] + ends[1]) / 2
                contrasts: list[np.ndarray] = []
                for ortho, balance in (
                    (whole, Balance()),
                    (by_name[a.photo_id], made.balances[a.photo_id]),
                    (by_name[b.photo_id], made.balances[b.photo_id]),
                ):
                    left, right = (
                        shown_at(ortho, balance, middle + sign * across, MEAN_PX)
                        for sign in (1, -1)
                    )
                    contrasts.append(left - right)
                found.append(np.abs(contrasts[0] - (contrasts[1] + contrasts[2]) / 2))
                alone.append(np.abs(contrasts[1] - contrasts[2]) / 2)
    mosaic, photo = np.concatenate(found), np.concatenate(alone)
    return mosaic[np.isfinite(mosaic)], photo[np.isfinite(photo)]


def shown_at(ortho: OrthoProduct, balance: Balance, places: np.ndarray, side: int) -> np.ndarray:
    """Corrected gray values of an ortho at places; NaN where it shows nothing."""
    low, high = places.min(axis=0) - 20, places.max(axis=0) + 20
    part: Grid = ortho.grid.covering((*low.tolist(), *high.tolist()))
    corner = np.rint(ortho.grid.grid_from_object(np.array([[part.west, part.north]]))[0])
    column, row = (int(value) for value in corner)
    with rasterio.open(ortho.path) as file:
        gray = file.read(
            1, window=((row, row + part.rows), (column, column + part.columns))
        ).astype(np.float32)
    corrected = balance.corrected(gray, part)
    corrected[gray == 0] = np.nan
    corrected = cv2.blur(corrected, (side, side))
    cells = np.floor(part.grid_from_object(places)).astype(int)
    inside = (cells >= 0).all(axis=1) & (cells < [part.columns, part.rows]).all(axis=1)
    values = np.full(len(places), np.nan)
    values[inside] = corrected[cells[inside, 1], cells[inside, 0]]
    return values


def say(text: str) -> None:
    """Print a line."""
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
