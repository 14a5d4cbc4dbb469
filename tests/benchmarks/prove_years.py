"""Several years of one place: is change found, and does one year's mosaic help another's?

Run: python -m tests.benchmarks.prove_years FOLDER [size] [seed ...]

Three epochs are flown over one synthetic landscape: ground is cut away and filled up, halls are
built, woods felled, roads and parcels change. Each block is run alone, on the ortho and DEM of
today, with its own surface; `gruber change` compares each year with the one before; and all but the
last are run again, tied to the mosaic of the next year. Blocks that are there are not made again.

Heights: agreement of areas (intersection over union) of what differs truly by more than a metre
with what was found, over ground of which both years know the height; what was found where nothing
has changed. Picture: cells whose parcels, roads, woods and soil are truly the same, or other ones.
"""

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import rasterio
from shapely import Polygon

from app.change import YearPair, compare_years, dated_blocks
from app.epochs import Epoch
from core.mosaic.change import DIFFERENT, SAME
from core.mosaic.comparison import compare_orthos
from core.progress import SILENT
from core.raster.grid import Grid, burn
from core.surface.ground import NODATA_M
from core.synthetic.changes import Change, risen
from core.synthetic.epochs import FlownEpoch, changes_between, make_epochs, plan_epochs
from core.synthetic.options import SyntheticOptions
from tests.benchmarks.large_desk import say

YEARS = (1938, 1953, 1984)
TRUE_M = 1.0
"""Heights that truly differ by more have changed."""
LABEL_M = 4.0
"""Pixel of the parcels that the truth of the picture is taken from."""
FOUND = 0.3
"""A change is found where so much of what differs truly there was."""


def run(folder: Path, *words: str) -> None:
    """A block, in a process of its own."""
    with (folder.parent / f"{folder.name}.log").open("w", encoding="utf-8") as log:
        command = [sys.executable, "-m", "gruber", "run", str(folder), *words]
        subprocess.run(command, stdout=log, stderr=log, check=True)


def made_blocks(folder: Path, options: SyntheticOptions) -> tuple[FlownEpoch, ...]:
    """The epochs, each run alone with its surface, and tied to the mosaic of the next."""
    if not (folder / str(YEARS[-1]) / "block.toml").is_file():
        make_epochs(folder, options, YEARS)
        for year in YEARS:
            with (folder / str(year) / "block.toml").open("a", encoding="utf-8") as file:
                file.write("\n[surface]\n")
    for year in YEARS:
        if not (folder / str(year) / "results" / "report.json").is_file():
            run(folder / str(year))
    for year, later in pairwise(YEARS):
        tied = folder / f"{year}-tied"
        if Epoch(tied).mosaic.is_file():
            continue
        shutil.rmtree(tied, ignore_errors=True)
        own = shutil.ignore_patterns("results", ".gruber", "*.sqlite*")
        shutil.copytree(folder / str(year), tied, ignore=own)
        text = (tied / "block.toml").read_text(encoding="utf-8").replace("\n[surface]\n", "")
        text += f'\n[[reference.other]]\nblock = "../{later}"\nties = true\n'
        (tied / "block.toml").write_text(text, encoding="utf-8")
        run(tied, "--until", "mosaic")
    return plan_epochs(options, YEARS)


def grid_of(path: Path) -> tuple[Grid, np.ndarray]:
    """Cells and values of a raster, NaN where nothing is known."""
    with rasterio.open(path) as file:
        values = file.read(1).astype(float)
        grid = Grid(file.transform.c, file.transform.f, file.transform.a, file.width, file.height)
    values[values == NODATA_M] = np.nan
    return grid, values


def heights_line(epochs: Sequence[FlownEpoch], pair: YearPair, raster: Path) -> str:
    """What was found of the changes of height, against the truth."""
    grid, away = grid_of(raster)
    changes = epochs[0].landscape.changes
    true = risen(grid, changes, pair.later) - risen(grid, changes, pair.earlier)
    known = np.isfinite(away)
    areas = () if pair.heights is None else pair.heights.areas
    signs = [(one.outline, 1 if one.mean_m > 0 else -1) for one in areas]
    found = burn(signs, grid.aside, empty=0)
    truly = np.where(np.abs(true) > TRUE_M, np.sign(true), 0).astype(int)
    hit = (found == truly) & (found != 0) & known
    either = ((found != 0) | (truly != 0)) & known
    agreement = hit.sum() / max(either.sum(), 1)
    false = [one for one in areas if not _touches(one.outline, truly, grid)]
    told = []
    between = changes_between(epochs, pair.earlier, pair.later)
    for kind in dict.fromkeys(change.kind for change in between):
        kept = [change for change in between if change.kind == kind]
        shares = [_share_found(change, hit, truly, known, grid) for change in kept]
        number = sum(share > FOUND for share in shares if np.isfinite(share))
        told.append(f"{kind} {number}/{sum(np.isfinite(share) for share in shares)}")
    cells_m2 = grid.ground_sample_distance_m**2
    volumes = [float(np.nansum(np.where(known, true, 0)[truly == s]) * cells_m2) for s in (1, -1)]
    own = [sum(one.volume_m3 for one in areas if one.mean_m * s > 0) for s in (1, -1)]
    return (
        f"| {pair.name} | {agreement:.2f} | {', '.join(told)} | {len(false)} of {len(areas)}, "
        f"{sum(one.area_m2 for one in false) / 1e4:.2f} ha of {known.sum() * cells_m2 / 1e4:.0f} | "
        f"{own[0]:.0f} of {volumes[0]:.0f}, {own[1]:.0f} of {volumes[1]:.0f} |"
    )


def _touches(outline, truly: np.ndarray, grid: Grid) -> bool:
    return bool(truly[burn([(outline, 1)], grid.aside, empty=0) == 1].any())


def _share_found(
    change: Change, hit: np.ndarray, truly: np.ndarray, known: np.ndarray, grid: Grid
) -> float:
    """Share of a change that was found; NaN where hardly any of it has heights in both years."""
    inside = burn([(Polygon(change.outline), 1)], grid.aside, empty=0) == 1
    there = inside & (truly != 0)
    if (there & known).sum() < FOUND * max(there.sum(), 1):
        return float("nan")
    return float(hit[there].sum() / (there & known).sum())


def picture_line(epochs: Sequence[FlownEpoch], pair: YearPair) -> str:
    """What was found of the changes of the picture, against the truth."""
    cells, state = pair.picture.grid, pair.picture.state
    step = max(1, round(cells.ground_sample_distance_m / LABEL_M))
    fine = Grid(
        cells.west,
        cells.north,
        cells.ground_sample_distance_m / step,
        cells.columns * step,
        cells.rows * step,
    )
    labels = [_labels(epoch, fine) for epoch in epochs if epoch.year in (pair.earlier, pair.later)]
    other = (labels[0] != labels[1]).reshape(cells.rows, step, cells.columns, step)
    share = other.mean(axis=(1, 3))
    seen = pair.picture.seen
    new, old = seen & (share > 0.5), seen & (share < 0.1)
    different, same = seen & (state == DIFFERENT), seen & (state == SAME)
    agreement = (different & new).sum() / max((different | new).sum(), 1)
    told = []
    for truly in (new, old):
        shares = [100 * (said & truly).sum() / max(truly.sum(), 1) for said in (different, same)]
        told.append(f"{truly.sum()} | {shares[0]:.0f} % | {shares[1]:.0f} %")
    return f"| {pair.name} | {told[0]} | {told[1]} | {agreement:.2f} |"


def _labels(epoch: FlownEpoch, grid: Grid) -> np.ndarray:
    """A number for what covers each pixel, the same where it is the same in two epochs."""
    tracts = epoch.landscape.scene(True, grid).tracts
    shapes = [(Polygon(t.outline), hash(t.outline.round(1).tobytes()) % 1_000_003) for t in tracts]
    wood = [c for c in epoch.landscape.changes if c.kind in ("wood", "hall")]
    shapes += [(Polygon(c.outline), 1) for c in wood if c.stands(epoch.year)]
    return burn(shapes, grid.aside, empty=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where blocks are kept")
    parser.add_argument("size", choices=("tiny", "small"), nargs="?", default="tiny")
    parser.add_argument("seeds", type=int, nargs="*", default=[9224])
    given = parser.parse_args()
    heights, pictures, errors = [], [], []
    for seed in given.seeds:
        options, place = SyntheticOptions(given.size, seed=seed), given.folder / str(seed)
        epochs = made_blocks(place, options)
        blocks = dated_blocks([place / str(year) for year in YEARS])
        for pair in compare_years(blocks, place / "change", SILENT):
            raster = place / "change" / f"height_change_{pair.earlier}_{pair.later}.tif"
            heights.append(heights_line(epochs, pair, raster).replace("|", f"| {seed}", 1))
            pictures.append(picture_line(epochs, pair).replace("|", f"| {seed}", 1))
        for year in YEARS[:-1]:
            truth = place / str(year) / "truth" / "archival_ortho.tif"
            alone, tied = (
                compare_orthos(Epoch(place / name).mosaic, truth)
                for name in (f"{year}", f"{year}-tied")
            )
            errors.append(
                f"| {seed} {year} | {alone.m_p:.2f} | {tied.m_p:.2f} | "
                f"{np.hypot(*alone.nmad):.2f} | {np.hypot(*tied.nmad):.2f} | "
                f"{alone.n}, {tied.n} |"
            )
    say(
        "| heights | agreement | found | false alarms | m3 raised, lowered |\n|---|---|---|---|---|"
    )
    say("\n".join(heights))
    say(
        "| picture | truly other cells | called different | the same | truly the same | "
        "called different | the same | agreement |\n|---|---|---|---|---|---|---|---|"
    )
    say("\n".join(pictures))
    say("| mosaic | m_p alone | tied | NMAD alone | tied | places |\n|---|---|---|---|---|---|")
    say("\n".join(errors))


if __name__ == "__main__":
    main()
