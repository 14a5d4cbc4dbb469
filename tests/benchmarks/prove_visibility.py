"""How much of orthos and mosaic is a ghost: ground shown where something higher hides it.

Run: python -m tests.benchmarks.prove_visibility [first seed] [blocks] [folder for pictures]

Blocks of eight photos in two strips over hills with houses and woods. Orthos are made on the true
heights and on the photos' own surface, without and with visibility. Truth: rays in steps of half a
pixel over the raster of true heights that the scans were computed from. A pixel of the mosaic is a
ghost if the place is hidden from the photo that shows it; which that is, a mosaic of orthos of one
gray value each says, on the same seams. Pixels that two photos share are left out. Precision is
that to a pixel: a pixel beside what is hidden is left out on purpose.
"""

import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import rasterio

from core.mosaic.composition import MosaicOptions, compose_mosaic
from core.orthos.rectification import OrthoOptions, OrthoProduct, rectify_photo
from core.orthos.scan_places import Heights
from core.raster.dem import Dem, open_dem
from core.raster.grid import Grid, tiled_profile
from core.surface.ground import choose_ground, read_ground
from tests.benchmarks.large_desk import say
from tests.benchmarks.prove_ground import DEM_SIGMA_M, central, pixels_of
from tests.benchmarks.prove_surface import made
from tests.surface_scene import CRS, SurfacePlan, SurfaceScene, make_scene

PIXEL_M = 0.3
"""Of the scans, on the ground."""
GRAY = 20
"""Between the gray values that stand for photos."""
BESIDE_M = 15.0
"""What is no farther from a house or a wood is near."""
OBJECT_M = 2.0


def hidden_in_truth(
    scene: SurfaceScene, centre: np.ndarray, grid: Grid, near: np.ndarray
) -> np.ndarray:
    """Rays go up from each pixel near an object until they are higher than everything."""
    surface = scene.surface.astype(np.float32)
    east, north = (part.ravel() for part in np.meshgrid(*grid.centres()))
    places, top = np.column_stack([east, north])[near.ravel()], float(surface.max())

    def heights(points: np.ndarray) -> np.ndarray:
        place = (scene.grid.grid_from_object(points) - 0.5).astype(np.float32)
        rows = len(place) // 8192 + 1
        padded = np.zeros((rows * 8192, 2), np.float32)
        padded[: len(place)] = place
        maps = padded.reshape(rows, 8192, 2)
        found = cv2.remap(surface, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR)
        return found.ravel()[: len(place)]

    step_m = scene.plan.ground_pixel_m / 2
    ground, run = heights(places), np.hypot(*(places - centre[:2]).T)
    hidden, left, step = np.zeros(len(places), dtype=bool), np.arange(len(places)), 0
    while len(left):
        step += 1
        share = step * step_m / run[left]
        ray = ground[left] + (centre[2] - ground[left]) * share
        going = (share < 1) & (ray < top)
        left, share, ray = left[going], share[going, None], ray[going]
        above = heights(places[left] + (centre[:2] - places[left]) * share) > ray + 0.02
        hidden[left[above]] = True
        left = left[~above]
    whole = np.zeros(near.shape, dtype=bool)
    whole[near] = hidden
    return whole


@dataclass(frozen=True)
class Made:
    """Orthos, their mosaic, and which of them shows each of its pixels."""

    orthos: list[OrthoProduct]
    mosaic: np.ndarray
    shown_by: np.ndarray


def make(scene: SurfaceScene, heights: Heights, grid: Grid, seen: bool, folder: Path) -> Made:
    camera = next(iter(scene.block.cameras.values()))
    options, orthos = OrthoOptions(visibility=seen), []
    for photo in scene.block.photos.values():
        path = folder / f"{photo.photo_id}.tif"
        orthos.append(rectify_photo(photo, camera, heights, grid, path, CRS, options=options))
    mosaic = compose_mosaic(orthos, grid, folder / "m.tif", None)
    grays = [named(ortho, GRAY * (k + 1), folder) for k, ortho in enumerate(orthos)]
    plain = MosaicOptions(balance=False, feather_only=True)
    names = compose_mosaic(grays, grid, folder / "n.tif", None, seams=mosaic.seams, options=plain)
    by = band(names.path)
    return Made(orthos, band(mosaic.path), np.where(by % GRAY == 0, by // GRAY - 1, -2))


def ratio(scene: SurfaceScene, heights: Heights, folder: Path) -> float:
    """Processor time of orthos on their own grids, with visibility over without."""
    camera, seconds = next(iter(scene.block.cameras.values())), {False: 0.0, True: 0.0}
    for photo in list(scene.block.photos.values())[:4]:
        # Whatever is read once is read before the time is taken.
        for count, seen in enumerate((False, False, True)):
            options, began = OrthoOptions(visibility=seen), time.process_time()
            pixel = scene.plan.ground_pixel_m
            rectify_photo(photo, camera, heights, pixel, folder / "o.tif", CRS, options=options)
            seconds[seen] += (time.process_time() - began) * (count > 0)
    return seconds[True] / seconds[False]


def named(ortho: OrthoProduct, gray: int, folder: Path) -> OrthoProduct:
    """An ortho of one gray value wherever it shows anything."""
    path = folder / f"gray_{gray}.tif"
    with rasterio.open(ortho.path) as file:
        values, profile = file.read(1), file.profile
    with rasterio.open(path, "w", **profile) as file:
        file.write(np.where(values > 0, gray, 0).astype(np.uint8), 1)
    return replace(ortho, path=path)


def band(path: Path) -> np.ndarray:
    with rasterio.open(path) as file:
        return file.read(1).astype(int)


def heights_of(scene: SurfaceScene, folder: Path) -> dict[str, Heights]:
    """True heights, and those of `ground = "surface"`."""
    true = raster_of(scene.surface, scene.grid, folder / "dsm.tif")
    surface, _ = made(scene, folder)
    files = [folder / f"ground_{what}.tif" for what in ("classes", "corrections")]
    choose_ground(
        surface.files.difference,
        surface.files.sigma,
        "surface",
        DEM_SIGMA_M,
        classes=files[0],
        corrections=files[1],
    )
    whole, cell = scene.grid, scene.grid.ground_sample_distance_m * 8
    coarse = Grid(whole.west, whole.north, cell, whole.columns // 8, whole.rows // 8)
    dem = raster_of(scene.on(scene.dem, coarse), coarse, folder / "dem.tif")
    return {"true": true, "surface": read_ground(files[1], dem)}


def raster_of(heights: np.ndarray, grid: Grid, path: Path) -> Dem:
    """Heights as a block would read them."""
    with rasterio.open(path, "w", **tiled_profile(grid, CRS, "float32")) as file:
        file.write(heights.astype(np.float32), 1)
    return open_dem(path, CRS).cropped(grid.bounds)


def told(
    usual: Made, true: Made, hidden: Sequence[np.ndarray], near: np.ndarray
) -> dict[str, float]:
    """Figures in percent."""
    right = found = wanted = had = 0
    for one, other, truth in zip(usual.orthos, true.orthos, hidden, strict=True):
        seen = pixels_of(one) > 0
        left = seen & (pixels_of(other) == 0) if one is not other else np.zeros_like(seen)
        beside = cv2.dilate(truth.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        right, found = right + (left & beside).sum(), found + left.sum()
        wanted, had = wanted + (truth & seen).sum(), had + (truth & left).sum()
    every = np.stack(hidden)

    def ghosts(made: Made) -> float:
        by = made.shown_by
        counted = (by >= 0) & near
        ghost = np.take_along_axis(every, np.maximum(by, 0)[None], 0)[0]
        return 100 * (ghost & counted).sum() / counted.sum()

    inside = near & (usual.mosaic > 0)
    return {
        "precision": 100 * right / max(found, 1),
        "recall": 100 * had / wanted,
        "ghosts": ghosts(usual),
        "ghosts_seen": ghosts(true),
        "holes": 100 * (inside & (true.mosaic == 0)).sum() / inside.sum(),
    }


def main() -> None:
    words = sys.argv[1:]
    first, blocks = int(words[0]) if words else 9331, int(words[1]) if words[1:] else 2
    pictures = Path(words[2]) if words[2:] else None
    say(
        "| seed | heights | precision | recall | ghosts near objects without | with | "
        "holes near objects | hidden in every photo | time |"
    )
    say("|---|---|---|---|---|---|---|---|---|")
    for seed in range(first, first + blocks):
        plan = SurfacePlan(
            photos=4,
            strips=2,
            size_px=1000,
            ground_pixel_m=PIXEL_M,
            relief_m=30,
            houses=80,
            woods=3,
            changes_m=0,
        )
        with tempfile.TemporaryDirectory() as name:
            block(make_scene(plan, Path(name), seed), Path(name), seed, pictures)


def block(scene: SurfaceScene, folder: Path, seed: int, pictures: Path | None) -> None:
    grid = central(scene, scene.plan.ground_pixel_m)
    high = scene.on(scene.surface - scene.ground, grid, np.max) > OBJECT_M
    reach = round(BESIDE_M / grid.ground_sample_distance_m)
    near = cv2.dilate(high.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) > 0
    hidden = [
        hidden_in_truth(scene, photo.exterior.centre, grid, near)
        for photo in scene.block.photos.values()
    ]
    for kind, heights in heights_of(scene, folder).items():
        parts = {seen: folder / f"{kind}_{seen}" for seen in (False, True)}
        for part in parts.values():
            part.mkdir()
        usual, true = (make(scene, heights, grid, seen, part) for seen, part in parts.items())
        shows = np.stack([pixels_of(ortho) > 0 for ortho in usual.orthos])
        never = (np.stack(hidden) | ~shows).all(axis=0) & shows.any(axis=0)
        inside = near & (usual.mosaic > 0)
        figures, taken = told(usual, true, hidden, near), ratio(scene, heights, folder)
        say(
            f"| {seed} | {kind} | {figures['precision']:.1f} | {figures['recall']:.1f} | "
            f"{figures['ghosts']:.2f} | {figures['ghosts_seen']:.2f} | {figures['holes']:.3f} | "
            f"{100 * (never & inside).sum() / inside.sum():.3f} | {taken:.2f} |"
        )
        if pictures is not None:
            for what, one in (("without", usual), ("with", true)):
                path = str(pictures / f"{seed}_{kind}_{what}.png")
                cv2.imwrite(path, one.mosaic.astype(np.uint8))


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main()
