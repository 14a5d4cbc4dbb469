"""The experiments of the thesis repeated on a block with truth: its tables beside ours, and a log.

The photos begin as well georeferenced as the thesis's after their repair, and every match is
judged by the truth. What the thesis prints is quoted with its place.
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from app.project import described, read_project
from core.arrays import ObjectPoints, PixelPoints
from core.block import Block, footprint
from core.errors import ReferenceDataError
from core.formats.roads import Roads, read_roads
from core.geometry.exterior import ExteriorOrientation
from core.literature.common_grid import (
    Band,
    Candidate,
    built_up,
    candidates_in,
    lay_on_grid,
    looked_at_on_grid,
    sizes_px,
)
from core.literature.detectors import is_installed
from core.literature.one_window import Sizes
from core.literature.operator_variants import paired
from core.literature.published_chains import (
    KOBYLI_1938,
    KOBYLI_1984,
    MILOVICE_1938,
    PublishedOptions,
    RansacOptions,
    agreeing_points,
)
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference, open_reference
from core.progress import Progress
from core.raster.grid import Grid
from core.raster.ortho import Ortho, open_ortho
from core.raster.scan_file import open_scan
from core.reference.stage import junctions_of
from core.synthetic.options import seeded
from core.synthetic.truth import WRONG_M, Truth, read_truth
from sessions.atomic_write import whole_file

Cell = str | float | None
"""A text as it stands, a word (`@name`), a figure, or nothing."""
REPAIRED_M = (6.83, 8.08)
"""RMSE of the repaired georeference in X and Y (thesis, Table 3)."""
LASTS_M = 15.0
"""A junction this near to one that stood already is that one: crossings are surveyed anew."""
SEARCH_1984_M, SEARCH_1938_M = 82.0, KOBYLI_1938.window
"""Edge of the area searched: of Table 4 (thesis, p. 71), and of Kobylí 1938 (Table 6)."""
TABLE_2_GSD_M = 2.0
"""Both pictures were resampled so (thesis 4.3)."""
TWO_PIXELS_M = 2 * TABLE_2_GSD_M
"""A pair of Table 2 is right within this."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A block with truth as an experiment takes it."""

    name: str
    """Of the block."""
    truth: Truth
    """What is true."""
    photos: tuple[OpenPhoto, ...]
    """Photos where the repaired georeference puts them."""
    reference: Reference
    """Today's ortho, and heights."""
    older: Ortho
    """The ground when the photos were taken, as the truth has it."""
    junctions: ObjectPoints
    """Junctions that stood already, as far as the truth tells."""
    roads: Roads
    """Roads of the map."""

    def misses_m(self, opened: OpenPhoto, pixel: PixelPoints, junction: int) -> np.ndarray:
        """How far a scan pixel truly shows ground from a junction: E and N, metres."""
        place = self.junctions[junction : junction + 1]
        shown = self.truth.ground_of(opened.photo.photo_id, pixel, self.truth.heights_at(place))
        return (shown - place[:, :2])[0]


@dataclass(frozen=True, slots=True)
class Table:
    """What an experiment says."""

    name: str
    """Of the experiment."""
    columns: tuple[str, ...]
    """Their words (`experiment.column.NAME`)."""
    rows: tuple[tuple[Cell, ...], ...]
    """A cell for each column."""
    matches: tuple[Mapping[str, Any], ...] = field(default=())
    """Every match behind them, for the log."""


def open_ground(folder: Path) -> Ground:
    """A block with truth.

    Raises:
        PhotogrammetryError: The block cannot be used, or has no truth.
    """
    truth = truth_of(folder)
    given = described(read_project(folder))
    scans = {scan.path.stem: scan.path for scan in given.scans if scan.path.stem in truth.photos}
    bare = open_reference(given.reference)
    level = bare.dem.mean_height()
    photos = {name: truth.photo(name, path, level) for name, path in scans.items()}
    block = Block(given.reference.crs, {truth.camera.name: truth.camera}, photos)
    bounds = block.search_bounds
    reference = open_reference(given.reference, bounds)
    roads = read_roads(given.reference.roads, given.reference.crs, bounds)
    found = junctions_of(roads, reference, given.reference, bounds)
    places = np.array([junction.position for junction in found]).reshape(-1, 3)
    if truth.lasting_junctions is not None:
        away = np.linalg.norm(places[:, None, :2] - truth.lasting_junctions, axis=2)
        places = places[away.min(axis=1, initial=np.inf) <= LASTS_M]
    opened = tuple(
        OpenPhoto(photo, truth.camera, open_scan(photo.scan)).at(repaired(photo.exterior, name))
        for name, photo in photos.items()
    )
    older = open_ortho([truth.archival_ortho], given.reference.crs)
    return Ground(given.name, truth, opened, reference, older, places, roads)


def truth_of(folder: Path) -> Truth:
    """The truth of a block.

    Raises:
        PhotogrammetryError: There is no block, or it has no truth.
    """
    if not (folder / "block.toml").is_file():
        raise ReferenceDataError(
            folder,
            "There is no block.",
            "Make one with `gruber demo --headless`, or name another one with truth.",
        )
    return read_truth(folder)


def repaired(true: ExteriorOrientation, name: str) -> ExteriorOrientation:
    """A photo as far off as the thesis's repaired georeferences were."""
    off = seeded(1, "repaired georeference", name).normal(0, REPAIRED_M)
    return replace(true, centre=true.centre + np.append(off, 0.0))


def table_2(ground: Ground, progress: Progress) -> Table:
    """Operators: which variant pairs how many points rightly; `+` is within built-up land."""
    surf = "surf-vdd" if is_installed("surf") else ""
    verdicts = {
        "1 SIFT-D": ("sift-d", "failed"),
        "2 SIFT-DD": ("sift-dd", "failed"),
        "3 SIFT-VD": ("sift-vd", "failed"),
        "4 SIFT-VDD": ("sift-vdd", "failed"),
        "5 SURF-VDD": (surf, "worse"),
        "6 ORB-VDD": ("orb-vdd", "worse"),
        "7 NCC-VD": ("ncc-vd", "best"),
        "– ORB-VD": ("orb-vd", ""),
        "– CFOG-VD": ("cfog-vd", ""),
        "– SIFT-DD +": ("sift-dd+", ""),
        "– SIFT, NCC": ("ncc-k", ""),
        "– SIFT, NCC +": ("ncc-k+", ""),
    }
    options = replace(MILOVICE_1938, gsd_m=TABLE_2_GSD_M)
    sizes = Sizes(*sizes_px(options))
    chance = 100 * np.pi * (TWO_PIXELS_M / (options.window - options.template)) ** 2
    found: dict[str, list[float]] = {way: [] for way, _ in verdicts.values()}
    for number, opened in enumerate(ground.photos):
        progress.report(number, len(ground.photos), opened.photo.photo_id)
        for way, misses in paired_misses(ground, opened, options, sizes, tuple(found)).items():
            found[way] += misses
    rows = tuple(
        (
            label,
            f"@verdict.{verdict}" if verdict else None,
            float(len(found[way])),
            100 * float(np.mean(np.array(found[way]) <= TWO_PIXELS_M)) if found[way] else None,
            float(np.median(found[way])) if found[way] else None,
            chance if found[way] else None,
        )
        for label, (way, verdict) in verdicts.items()
    )
    matches = tuple({"variant": way, "misses_m": np.round(m, 2)} for way, m in found.items() if m)
    return Table("table-2", ("variant", "thesis", "pairs", "right2", "median", "chance"), rows,
                 matches)  # fmt: skip


def paired_misses(
    ground: Ground, opened: OpenPhoto, options: PublishedOptions, sizes: Sizes, ways: Sequence[str]
) -> dict[str, list[float]]:
    """How far the pairs of each variant truly are apart in one photo, metres."""
    west, south, east, north = footprint(opened.photo, opened.camera).bounds
    grid = Grid.over((west, south, east, north), options.gsd_m)
    pair = lay_on_grid(opened, ground.reference.ortho, ground.reference.dem, grid, 0.0)
    places = grid.grid_from_object(ground.junctions[:, :2])
    reach = sizes.inner + sizes.half + 1
    size = np.array([grid.columns, grid.rows])
    kept = [
        place
        for place in places[((places > reach) & (places < size - reach)).all(axis=1)]
        for column, row in [place.astype(int).tolist()]
        if pair.seen[row - reach : row + reach, column - reach : column + reach].all()
    ]
    found, houses = dict[str, list[float]](), built_up(ground.roads, grid)
    for way in filter(None, ways):
        land = houses if way.endswith("+") else None
        pairs = paired(way.rstrip("+"), pair, np.array(kept).reshape(-1, 2), sizes, land)
        known = grid.object_from_grid(pairs[:, 1])
        flat = np.column_stack([known, ground.reference.dem.heights(known)])
        heights = ground.truth.heights_at(flat)
        shown = ground.truth.ground_of(
            opened.photo.photo_id, pair.scan_pixels(pairs[:, 0]), heights
        )
        found[way] = np.linalg.norm(shown - known, axis=1).tolist()
    return found


@dataclass(frozen=True, slots=True)
class Variant:
    """One column of the thesis's tables 4 and 5: inputs, and what it prints of them."""

    label: str
    """Its number or name there."""
    older: bool
    """Whether the ortho is the older one."""
    gsd_m: float
    """Ground sample distance of scan and ortho."""
    template_m: float
    """Side of the patch."""
    band: Band
    """What is taken of the ortho."""
    printed: tuple[float, float, float]
    """Mean correlation, RMSE X and RMSE Y, metres."""


TABLE_4 = (
    Variant("1", False, 1.0, 51, "grey", (0.521, 4.18, 5.40)),
    Variant("2", True, 1.0, 51, "grey", (0.438, 11.07, 11.80)),
    Variant("3", False, 0.5, 51, "grey", (0.483, 4.24, 5.39)),
    Variant("4", False, 0.35, 51, "green", (0.472, 4.18, 5.38)),
    Variant("5", False, 0.35, 51, "grey", (0.480, 4.08, 5.40)),
    Variant("6", True, 0.5, 51, "grey", (0.428, 10.66, 10.74)),
    Variant("7", False, 0.35, 41, "grey", (0.526, 6.76, 6.67)),
    Variant("8", False, 0.35, 61, "grey", (0.396, 4.78, 5.33)),
    Variant("9", False, 0.35, 51, "nearest", (0.463, 4.08, 5.40)),
)
"""Thesis, Table 4 (Kobylí 1984): one pixel a junction, no limit."""
TABLE_5 = (
    Variant("50s", True, 1.0, 51, "grey", (0.409, 9.90, 8.65)),
    Variant("green", False, 1.0, 51, "green", (0.379, 8.55, 8.70)),
    Variant("RGB2grey", False, 1.0, 51, "grey", (0.372, 8.77, 8.86)),
)
"""Thesis, Table 5 (Kobylí 1938)."""


def table_4(ground: Ground, progress: Progress) -> Table:
    """Inputs of the correlation, photos of the 1980s."""
    return _compared("table-4", TABLE_4, SEARCH_1984_M, ground, progress)


def table_5(ground: Ground, progress: Progress) -> Table:
    """Reference orthos, photos of the 1930s."""
    return _compared("table-5", TABLE_5, SEARCH_1938_M, ground, progress)


def _compared(
    name: str, variants: Sequence[Variant], window_m: float, ground: Ground, progress: Progress
) -> Table:
    """Correlation and errors of every variant beside what the thesis prints."""
    rows: list[tuple[Cell, ...]] = []
    matches: list[Mapping[str, Any]] = []
    for number, one in enumerate(variants):
        progress.report(number, len(variants), one.label)
        scores, misses = np.zeros(0), np.zeros((0, 2))
        for opened in ground.photos:
            own = _best_of(ground, opened, one, window_m)
            scores = np.append(scores, [candidate.score for candidate, _ in own])
            misses = np.vstack([misses, *(miss[None] for _, miss in own)])
            matches += [
                {"variant": one.label, "photo": opened.photo.photo_id, "junction": c.junction,
                 "ncc": round(c.score, 3), "miss_m": np.round(miss, 2)}
                for c, miss in own
            ]  # fmt: skip
        rows.append(_compared_row(one, scores, misses))
    columns = ("variant", "ortho", "gsd", "patch", "band", "ncc.t", "x.t", "y.t", "mean.t",
               "ncc", "x", "y", "mean", "right", "count")  # fmt: skip
    return Table(name, columns, tuple(rows), tuple(matches))


def _best_of(
    ground: Ground, opened: OpenPhoto, one: Variant, window_m: float
) -> list[tuple[Candidate, np.ndarray]]:
    """The best pixel of every junction of a photo, and how far it is off."""
    options = replace(
        KOBYLI_1984, gsd_m=one.gsd_m, template=one.template_m, window=window_m, best=1,
        least_ncc=-1.0,
    )  # fmt: skip
    ortho = ground.older if one.older else ground.reference.ortho
    seen = looked_at_on_grid(
        opened, ortho, ground.reference.dem, ground.junctions, options, one.band
    )
    return [
        (candidate, ground.misses_m(opened, candidate.pixel, candidate.junction))
        for number, pair in seen
        for candidate in candidates_in(number, pair, options)
    ]


def _compared_row(one: Variant, scores: np.ndarray, misses: np.ndarray) -> tuple[Cell, ...]:
    ncc, x, y = one.printed
    told = one.label, "@ortho.older" if one.older else "@ortho.today", one.gsd_m, one.template_m
    printed = f"@band.{'one' if one.older else one.band}", ncc, x, y, (x + y) / 2
    if not len(scores):
        return *told, *printed, None, None, None, None, None, 0.0
    ours = np.sqrt(np.mean(misses**2, axis=0)).tolist()
    right = 100 * float(np.mean(np.linalg.norm(misses, axis=1) <= WRONG_M))
    return (*told, *printed, float(scores.mean()), *ours, sum(ours) / 2, right,
            float(len(scores)))  # fmt: skip


def graph_5(ground: Ground, progress: Progress) -> Table:
    """How many candidates each step leaves, how many are right, and how many chance leaves."""
    options, matches = MILOVICE_1938, list[Mapping[str, Any]]()
    counted: dict[str, list[float]] = {}
    for number, opened in enumerate(ground.photos):
        progress.report(number, len(ground.photos), opened.photo.photo_id)
        seen = list(
            looked_at_on_grid(
                opened, ground.reference.ortho, ground.reference.dem, ground.junctions, options
            )
        )
        counts = [float(len(seen))]
        for mirrored in (False, True):
            found = [
                one for name, pair in seen for one in candidates_in(name, pair, options, mirrored)
            ]
            kept = _agreeing(ground, opened, found, options)
            right = [
                bool(np.linalg.norm(ground.misses_m(opened, one.pixel, one.junction)) <= WRONG_M)
                for one in found
            ]
            counts += [float(len({one.junction for one in found})), float(len(found))]
            counts += [] if mirrored else [float(sum(right))]
            counts += [float(len(kept))]
            counts += [] if mirrored else [float(sum(right[i] for i in kept))]
            matches.append(
                {"photo": opened.photo.photo_id, "mirrored": mirrored, "kept": kept,
                 "candidates": [{**asdict(one), "right": r}
                                for one, r in zip(found, right, strict=True)]}
            )  # fmt: skip
        counted[opened.photo.photo_id] = counts
    counted["@sum"] = [sum(column) for column in zip(*counted.values(), strict=True)]
    columns = ("photo", "junctions", "above", "clusters", "clusters.right", "agree",
               "agree.right", "above.chance", "clusters.chance", "agree.chance")  # fmt: skip
    rows = tuple((name, *counts) for name, counts in counted.items())
    return Table("graph-5", columns, rows, tuple(matches))


def _agreeing(
    ground: Ground, opened: OpenPhoto, found: Sequence[Candidate], options: PublishedOptions
) -> list[int]:
    """Candidates that the thesis's RANSAC keeps."""
    if not found:
        return []
    owner = np.array([one.junction for one in found])
    limit = (options.ransac_m or 0.0) / opened.ground_pixel_m
    ransac = RansacOptions(options.samples, limit, options.transform)
    return agreeing_points(
        ground.junctions[owner],
        np.vstack([one.pixel for one in found]),
        owner,
        ransac,
        seeded(1, "graph-5", opened.photo.photo_id),
    ).tolist()


EXPERIMENTS: dict[str, Callable[[Ground, Progress], Table]] = {
    "table-2": table_2,
    "table-4": table_4,
    "table-5": table_5,
    "graph-5": graph_5,
}
"""By the name that `--experiment` takes."""


def write_log(folder: Path, ground: Ground, table: Table, seconds: float) -> Path:
    """What was done and found, match by match; returns the file."""
    path = folder / "results" / "experiments" / f"{table.name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    told = {
        "experiment": table.name,
        "block": ground.name,
        "program": version("gruber"),
        "finished": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "seconds": round(seconds, 1),
        "georeference_rmse_m": REPAIRED_M,
        "photos": [opened.photo.photo_id for opened in ground.photos],
        "junctions": len(ground.junctions),
        "columns": table.columns,
        "rows": table.rows,
        "matches": table.matches,
    }
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(told, default=_plain, indent=1) + "\n", encoding="utf-8")
    return path


def _plain(value: Any) -> Any:
    return value.tolist()
