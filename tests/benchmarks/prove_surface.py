"""How true a surface from the photos is, and its standard deviations, beside bare OpenCV SGBM.

Run: python -m tests.benchmarks.prove_surface [side of the scans, px] [first seed] [relief, m ...]
Run: python -m tests.benchmarks.prove_surface block FOLDER CELL_M [HEIGHTS.tif]
Run: python -m tests.benchmarks.prove_surface settings

Blocks of three photos over hills with houses, woods, an embankment and a quarry of 8 m that the DEM
does not know. NMAD of open ground is given in units of 0.3 px sqrt(2) H/B (METHODS 8). The peer
gets the same rectified pairs and the same fusion, but its own parallaxes. `block` measures a block
that was adjusted, against its DEM and other heights; `settings` runs half and double of each.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import rasterio
from scipy import ndimage

import core.surface.matching as matching
import core.surface.stage as stage
from app.project import described, read_project
from app.surface import surface_line, usable_parts
from core.doubts import Failure
from core.geometry.robust import nmad
from core.matching.reference import open_heights
from core.progress import Work
from core.raster.dem import open_dem
from core.surface.matching import Parallaxes
from core.surface.rectified import RectifiedPair
from core.surface.stage import SurfaceFiles, SurfaceOptions, SurfaceProduct, make_surface
from sessions.session import Session
from tests.benchmarks.large_desk import say
from tests.surface_scene import SurfacePlan, SurfaceScene, make_scene

SETTINGS = ("BLOCK_PX", "TONE_PX", "WINDOW_SIGMA_PX", "LEAST_TRUE", "MOST_SIGMA_PX")
CHANGED_M = 2.0
"""What differs more from the DEM is taken for change."""


def bare_match(pair: RectifiedPair, reach_px: int) -> Parallaxes:
    """OpenCV's semi-global matching as it comes: grey values, parallaxes to a sixteenth."""
    reach = -(-reach_px // 8) * 8
    matcher = cv2.StereoSGBM.create(
        -reach, 2 * reach, 5, 8 * 25, 32 * 25, 1, 31, 5, 100, 2, cv2.STEREO_SGBM_MODE_SGBM_3WAY
    )
    left, right = (np.clip(one.gray, 0, 255).astype(np.uint8) for one in (pair.left, pair.right))
    raw = matcher.compute(left, right)
    parallax = raw.astype(np.float32) / 16
    columns, rows = np.meshgrid(np.arange(left.shape[1]), np.arange(left.shape[0]))
    there = cv2.remap(
        pair.right.seen.astype(np.float32),
        (columns - parallax).astype(np.float32),
        rows.astype(np.float32),
        cv2.INTER_NEAREST,
    )
    found = (raw > -reach * 16) & pair.left.seen & (there > 0)
    return Parallaxes(parallax, np.full(raw.shape, 0.3, np.float32), np.zeros_like(parallax), found)


def made(scene: SurfaceScene, folder: Path) -> tuple[SurfaceProduct, float]:
    """The surface and the processor seconds it took."""
    began = time.process_time()
    surface = make_surface(
        scene.block,
        scene,
        SurfaceFiles.within(folder),
        lambda name: None,
        ties=np.zeros((0, 3)),
        options=SurfaceOptions(2 * scene.plan.ground_pixel_m),
        work=Work(),
    )
    assert not isinstance(surface, Failure)
    return surface, time.process_time() - began


def band_of(path: Path) -> np.ma.MaskedArray:
    with rasterio.open(path) as file:
        return file.read(1, masked=True)


def judged(scene: SurfaceScene, surface: SurfaceProduct) -> str:
    """Figures against the truth."""
    grid, unit = surface.grid, scene.plan.sigma_m
    error = band_of(surface.files.surface) - scene.on(scene.surface, grid)
    sigma = band_of(surface.files.sigma)
    free = scene.on(scene.open_ground, grid, np.all) & ~error.mask
    beside = ~scene.on(scene.open_ground, grid, np.all) & ~error.mask
    changed = scene.on(scene.changed, grid, np.mean) > 0.5
    standing = scene.on(scene.surface - scene.ground, grid, np.max) > 0.3
    difference = band_of(surface.files.difference)
    shown = ~difference.mask & ~standing
    found = ndimage.median_filter(np.abs(difference.filled(0)) > CHANGED_M, 7)
    either = ((found | changed) & shown).sum()
    agreement = (found & changed & shown).sum() / max(either, 1)
    values = error[free].compressed()
    return (
        f"NMAD {nmad(values) / unit:.2f} ({nmad(values):.2f} m)  bias {np.median(values):+.2f} m  "
        f"> 3 m {100 * np.mean(np.abs(values) > 3):.2f} %  "
        f"sigma ratio {nmad((error / sigma).compressed()):.2f}  "
        f"on open ground {nmad((error / sigma)[free].compressed()):.2f}  "
        f"at houses and woods {nmad((error / sigma)[beside].compressed()):.2f}  "
        f"complete {100 * surface.completeness:.1f} %  change found {agreement:.2f}"
    )


def with_matcher(match: Callable[[RectifiedPair, int], Parallaxes], call: Callable[[], str]) -> str:
    usual, stage.match_pair = stage.match_pair, match
    try:
        return call()
    finally:
        stage.match_pair = usual


def scenes(size: int, first: int, reliefs: list[float]) -> None:
    for seed, relief in enumerate(reliefs, start=first):
        plan = SurfacePlan(size_px=size, relief_m=relief)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            scene = make_scene(plan, folder, seed)

            def figures(scene: SurfaceScene = scene, folder: Path = folder) -> str:
                surface, seconds = made(scene, folder)
                return f"{judged(scene, surface)}  {seconds:.1f} s"

            say(
                f"seed {seed}, {plan.photos} photos of {size} px, relief {relief:g} m, "
                f"unit {plan.sigma_m:.2f} m"
            )
            say(f"  ours       {figures()}")
            say(f"  bare SGBM  {with_matcher(bare_match, figures)}")


def block(folder: Path, cell_m: float, heights: list[str]) -> None:
    """A block that was run up to its adjustment."""
    project = read_project(folder)
    with Session.open(folder, "prove") as session, tempfile.TemporaryDirectory() as name:
        report = session.products.latest_value("adjustment")
        given = described(project)
        dem = open_heights(given.reference).cropped(report.block.bounds)
        began = time.process_time()
        surface = make_surface(
            report.block,
            dem,
            SurfaceFiles.within(Path(name)),
            usable_parts(session),
            ties=report.tie_positions,
            options=SurfaceOptions(cell_m),
            work=Work(),
        )
        seconds = time.process_time() - began
        say(f"{surface_line(surface)}; {seconds:.1f} s of processor time")
        assert not isinstance(surface, Failure)
        say(f"trend {np.round(surface.trend.coefficients, 2).tolist()} m")
        sigma, count = band_of(surface.files.sigma), band_of(surface.files.count)
        compare("DEM less trend", band_of(surface.files.difference), sigma, count)
        if heights:
            other = open_dem(heights, report.block.crs).on(surface.grid)
            compare("heights given", band_of(surface.files.surface) - other, sigma, count)


def compare(
    what: str, error: np.ma.MaskedArray, sigma: np.ma.MaskedArray, count: np.ma.MaskedArray
) -> None:
    for pairs in (0, *np.unique(count.compressed()).tolist()):
        here = ~np.ma.getmaskarray(error) & np.isfinite(error.filled(0))
        here &= (count.filled(0) == pairs) if pairs else True
        values = error[here].compressed()
        ratio = nmad((error / sigma)[here].compressed())
        say(
            f"  {what}, {pairs or 'all'} pairs: {len(values)} cells, "
            f"bias {np.median(values):+.2f} m, NMAD {nmad(values):.2f} m, over sigma {ratio:.2f}"
        )


def settings() -> None:
    plan = SurfacePlan(size_px=700, relief_m=20, houses=40, woods=3)
    with tempfile.TemporaryDirectory() as name:
        scene = make_scene(plan, Path(name), 7)
        say(f"as it is: {judged(scene, made(scene, Path(name))[0])}")
        for setting in SETTINGS:
            usual = getattr(matching, setting)
            for factor in (0.5, 2.0):
                value = usual * factor
                if isinstance(usual, int):
                    # Squares and windows have a middle.
                    value = max(3, int(value) // 2 * 2 + 1)
                setattr(matching, setting, value)
                say(f"{setting} {value:g}: {judged(scene, made(scene, Path(name))[0])}")
            setattr(matching, setting, usual)


if __name__ == "__main__":
    cv2.setNumThreads(1)
    arguments = sys.argv[1:]
    if arguments[:1] == ["block"]:
        block(Path(arguments[1]), float(arguments[2]), arguments[3:])
    elif arguments == ["settings"]:
        settings()
    else:
        scenes(
            int(arguments[0]) if arguments else 1600,
            int(arguments[1]) if arguments[1:] else 9301,
            [float(v) for v in arguments[2:]] or [60.0, 200.0],
        )
