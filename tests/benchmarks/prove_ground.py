"""How far orthos are displaced where the ground has changed: DEM, surface, automatic choice.

Run: python -m tests.benchmarks.prove_ground [first seed] [blocks]

Blocks of three photos over an embankment and a quarry of 8 m that the DEM does not know, with
houses and woods. Each photo is rectified on the DEM, on its block's own surface, on what `auto`
chooses, and on the true heights. Patches of an ortho are sought in that on the true heights: what
they lie off is their displacement. Ground that has not changed is measured, too: a ground that
mends the one may not spoil the other.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import rasterio

from core.block import Photo
from core.orthos.rectification import OrthoProduct, rectify_photo
from core.raster.dem import HeightSource
from core.raster.grid import Grid
from core.surface.ground import CorrectedHeights, GroundKind, choose_ground, read_ground
from tests.benchmarks.large_desk import say
from tests.benchmarks.prove_surface import made
from tests.surface_scene import SurfacePlan, SurfaceScene, make_scene

PATCH_PX, REACH_PX, STEP_PX = 25, 10, 12
MOST_PATCHES = 1000
DEM_SIGMA_M = 0.3
"""As a block would state it of the DEM of the scene, whose errors are 0.15 m and smooth."""
LEAST_LIKENESS = 0.7
"""Below, the patch was not found: a house that stands on its head."""


def heights_of(scene: SurfaceScene) -> dict[str, HeightSource]:
    """Heights under each kind of ortho."""
    found: dict[str, HeightSource] = {"dem": scene}
    with tempfile.TemporaryDirectory() as name:
        surface, _ = made(scene, Path(name))
        for kind in get_args(GroundKind)[1:]:
            files = [Path(name) / f"{kind}_{what}.tif" for what in ("classes", "corrections")]
            choose_ground(
                surface.files.difference,
                surface.files.sigma,
                kind,
                DEM_SIGMA_M,
                classes=files[0],
                corrections=files[1],
            )
            found[kind] = read_ground(files[1], scene)
    return found


def displacements(ortho: np.ndarray, true: np.ndarray, places: np.ndarray) -> np.ndarray:
    """How far patches at columns and rows lie off, pixels; NaN where they are not found."""
    half, found = PATCH_PX // 2, np.full(len(places), np.nan)
    for number, (column, row) in enumerate(places.tolist()):
        patch = ortho[row - half : row + half + 1, column - half : column + half + 1]
        reach = half + REACH_PX
        around = true[row - reach : row + reach + 1, column - reach : column + reach + 1]
        if patch.min() == 0 or around.min() == 0:
            continue
        likeness = cv2.matchTemplate(around, patch, cv2.TM_CCOEFF_NORMED)
        _, best, _, (x, y) = cv2.minMaxLoc(likeness)
        if best < LEAST_LIKENESS or not (0 < x < 2 * REACH_PX and 0 < y < 2 * REACH_PX):
            continue
        part = likeness[y - 1 : y + 2, x - 1 : x + 2]
        off = [
            place - REACH_PX + (first - last) / (2 * (first - 2 * middle + last))
            for place, (first, middle, last) in ((x, part[1]), (y, part[:, 1]))
        ]
        found[number] = np.hypot(*off)
    return found


def places_on(mask: np.ndarray) -> np.ndarray:
    """Columns and rows of patches that lie within a mask all over."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((PATCH_PX, PATCH_PX), np.uint8))
    rows, columns = np.nonzero(inner[::STEP_PX, ::STEP_PX])
    places = np.column_stack([columns, rows]) * STEP_PX
    room = PATCH_PX // 2 + REACH_PX
    fits = ((places >= room) & (places < np.array(mask.shape[::-1]) - room)).all(axis=1)
    return places[fits][:: max(1, int(fits.sum()) // MOST_PATCHES)]


def pixels_of(ortho: OrthoProduct) -> np.ndarray:
    with rasterio.open(ortho.path) as file:
        return file.read(1)


def measured(scene: SurfaceScene, folder: Path) -> dict[tuple[str, str], np.ndarray]:
    """Displacements in metres, by ground and by what became of the land."""
    gsd = scene.plan.ground_pixel_m
    truth = replace(scene, dem=scene.ground)
    # Slopes of the change included, but not a metre that the DEM is off by anyway.
    masks = {
        "changed": (scene.changed, np.all),
        "unchanged": (scene.open_ground & (np.abs(scene.dem - scene.ground) < 1.0), np.all),
    }
    camera = next(iter(scene.block.cameras.values()))
    found: dict[tuple[str, str], list[np.ndarray]] = {}
    kinds = heights_of(scene)
    area = central(scene, gsd)
    for photo in scene.block.photos.values():
        true = pixels_of(laid(photo, camera, truth, area, folder))
        inner = cv2.erode((true > 0).astype(np.uint8), np.ones((2 * REACH_PX + 1,) * 2)) > 0
        for kind, heights in kinds.items():
            ortho = pixels_of(laid(photo, camera, heights, area, folder))
            for what, (mask, how) in masks.items():
                places = places_on(scene.on(mask, area, how) & inner)
                off = displacements(ortho, true, places) * gsd
                found.setdefault((kind, what), []).append(off)
    return {key: np.concatenate(values) for key, values in found.items()}


def central(scene: SurfaceScene, gsd: float) -> Grid:
    """The part of the scene's raster that lies within the block, in pixels of the orthos."""
    whole, margin = scene.grid, 0.1
    ratio = round(gsd / whole.ground_sample_distance_m)
    columns, rows = (int(side * (1 - 2 * margin)) // ratio for side in (whole.columns, whole.rows))
    left, top = (int(side * margin) // ratio for side in (whole.columns, whole.rows))
    return Grid(whole.west + left * gsd, whole.north - top * gsd, gsd, columns, rows)


class Ground:
    """Heights as orthos want them: a spacing and a raster of a grid besides single places."""

    def __init__(self, source: HeightSource, spacing_m: float) -> None:
        self.source, self.ground_sample_distance_m = source, spacing_m

    def heights(self, points: np.ndarray) -> np.ndarray:
        return self.source.heights(points)

    def on(self, grid: Grid) -> np.ndarray:
        east, north = np.meshgrid(*grid.centres())
        plan = np.column_stack([east.ravel(), north.ravel()])
        return self.source.heights(plan).reshape(grid.rows, grid.columns)


def laid(
    photo: Photo, camera, heights: HeightSource | CorrectedHeights, grid: Grid, folder: Path
) -> OrthoProduct:
    """An ortho of a photo on some heights."""
    ground = Ground(heights, grid.ground_sample_distance_m)
    return rectify_photo(photo, camera, ground, grid, folder / "ortho.tif", "EPSG:5514")


def main() -> None:
    first, blocks = (int(word) for word in (*sys.argv[1:], "9301", "3")[:2])
    if len(sys.argv) == 2:
        blocks = 3
    say(
        "| block | relief | ground | land | patches | not found | RMS [m] | median [m] | 95 % [m] |"
    )
    say("|---|---|---|---|---|---|---|---|---|")
    for seed in range(first, first + blocks):
        relief = (60.0, 200.0)[seed % 2]
        with tempfile.TemporaryDirectory() as name:
            scene = make_scene(
                SurfacePlan(size_px=1000, relief_m=relief, houses=100, woods=5), Path(name), seed
            )
            for (kind, land), off in measured(scene, Path(name)).items():
                known = off[np.isfinite(off)]
                rms, (half, most) = np.sqrt(np.mean(known**2)), np.quantile(known, (0.5, 0.95))
                say(
                    f"| {seed} | {relief:g} m | {kind} | {land} | {len(off)} | "
                    f"{len(off) - len(known)} | {rms:.2f} | {half:.2f} | {most:.2f} |"
                )


if __name__ == "__main__":
    main()
