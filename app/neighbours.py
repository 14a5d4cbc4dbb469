"""Neighbouring blocks of an archive compared: what several of them hold, and how far it differs.

Only products and the ends of scans are read; no picture is opened. Nothing is written.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import combinations
from math import hypot
from pathlib import Path
from typing import Any, cast

import numpy as np
import shapely

from app.block_list import blocks_in, was_made
from app.block_toml import FILE
from app.project import Project, read_project
from app.report.protocol_figures import json_value
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.influence import influence_of
from core.arrays import ObjectPoints
from core.block import Block, footprint
from core.errors import PhotogrammetryError
from core.geometry.crs import degrees_of, operation_between, same_coordinates
from core.mosaic.misfit_places import Misfit
from core.progress import SILENT, Progress
from core.quality.neighbours import (
    LEVEL,
    Comparison,
    Difference,
    MisfitParts,
    Moved,
    NeighbourBlock,
    SharedGround,
    SharedPhoto,
    SharedPoint,
    compare_misfits,
    compare_photos,
    compare_points,
)
from core.quality.rules import release_limit_m
from core.said import Said, say
from sessions.products import Products, content_of
from sessions.session import products_of

Figures = Mapping[str, Any]
KEPT_BLOCKS = 6
"""Blocks whose equations are held at once; a block meets few neighbours at a time."""
NO_ADJUSTMENT = say("It is not adjusted yet, or by another version: run it.")
NOWHERE = say("Nothing of it has a place on the Earth.")


@dataclass(frozen=True, slots=True, eq=False)
class KnownBlock:
    """What is kept of every block of an archive."""

    path: str
    """As the list of blocks has it."""
    project: Project
    """Its settings."""
    digests: tuple[str, str]
    """Of its adjustment and of its misfit."""
    crs: str
    """Of its coordinates."""
    scans: Mapping[str, tuple[Path, tuple[int, int]]]
    """File and size in pixels by photo."""
    outlines: Mapping[str, shapely.Polygon]
    """Ground of every photo, longitude and latitude."""
    points: frozenset[str]
    """Points of the user."""
    held: Mapping[str, int]
    """Bytes of the scans that are there, by photo."""

    @property
    def products(self) -> Products:
        """Where its products lie."""
        return products_of(self.project.folder)

    @property
    def references(self) -> frozenset[tuple[str, int]]:
        """Name and size of each sheet of its reference."""
        files = self.project.reference.ortho
        return frozenset((path.name, path.stat().st_size) for path in files if path.is_file())


@dataclass
class Archive:
    """A folder of blocks; what was read and compared is kept until a block changes."""

    folder: Path
    """The folder."""
    _known: dict[str, tuple[object, KnownBlock | Said]] = field(default_factory=dict)
    _compared: dict[tuple[str, str], tuple[KnownBlock, KnownBlock, Figures]] = field(
        default_factory=dict
    )

    def figures(self, progress: Progress = SILENT) -> Figures:
        """Every pair of blocks that share a photo, a point or ground, the least likely first."""
        found = blocks_in(self.folder)
        listed = [path for path in found if was_made(self.folder / path, "control")]
        blocks: list[KnownBlock] = []
        left_out: list[Figures] = []
        for number, path in enumerate(listed):
            progress.report(number, 2 * len(listed), path)
            known = self._read(path)
            if isinstance(known, KnownBlock):
                blocks.append(known)
            else:
                left_out.append({"path": path, "why": known})
        near = neighbours_among(blocks)
        rows: list[Figures] = []
        for number, (one, other) in enumerate(near):
            progress.report(len(near) + number, 2 * len(near), f"{one.path}, {other.path}")
            rows.append(self._pair(one, other))
        # The next question may come hours later, or never.
        for kept in (_report, _equations):
            kept.cache_clear()
        told = "rows", "why", "one_sided", "namesakes"
        shared = [row for row in rows if any(row[name] for name in told)]
        return {
            "level": LEVEL,
            "blocks": len(blocks),
            "pairs": sorted(shared, key=_least_likely),
            "left_out": left_out,
            "unadjusted": len(found) - len(listed),
        }

    def _pair(self, one: KnownBlock, other: KnownBlock) -> Figures:
        """What two blocks share, compared again once one of them was read again."""
        kept = self._compared.get((one.path, other.path))
        if kept is not None and kept[0] is one and kept[1] is other:
            return kept[2]
        figures = _compared(one, other)
        self._compared[one.path, other.path] = one, other, figures
        return figures

    def _read(self, path: str) -> KnownBlock | Said:
        """What is kept of one block, or why it is not compared."""
        folder = self.folder / path
        products = products_of(folder.resolve())
        digests = products.latest_digest("adjustment"), products.latest_digest("misfit")
        state = digests, _changed(folder)
        if path in self._known and self._known[path][0] == state:
            kept = self._known[path][1]
            if not isinstance(kept, KnownBlock) or kept.held == _bytes_of(kept.scans):
                return kept
        try:
            found = _known_block(path, read_project(folder), products, digests)
        except PhotogrammetryError as error:
            found = error.told
        self._known[path] = state, found
        return found


def _changed(folder: Path) -> int:
    """When the settings of a block were written."""
    return (folder / FILE).stat().st_mtime_ns


def _known_block(
    path: str, project: Project, products: Products, digests: tuple[str, str]
) -> KnownBlock | Said:
    report = products.latest_value("adjustment")
    if not isinstance(report, AdjustmentReport):
        return NO_ADJUSTMENT
    block = report.block
    outlines = {
        name: outline
        for name, photo in block.photos.items()
        if (outline := _in_degrees(footprint(photo, block.camera_of(name)), block.crs)) is not None
    }
    if not outlines:
        return NOWHERE
    points = frozenset(
        name for name, one in block.surveyed.items() if one.source in ("surveyed", "hand")
    )
    scans = {name: (photo.scan, photo.size_px) for name, photo in block.photos.items()}
    held = _bytes_of(scans)
    return KnownBlock(path, project, digests, block.crs, scans, outlines, points, held)


def _in_degrees(outline: shapely.Polygon, crs: str) -> shapely.Polygon | None:
    """An outline on the Earth; None where nobody knows its place."""
    corners = degrees_of(crs, np.array(outline.exterior.coords))
    return shapely.Polygon(corners) if np.isfinite(corners).all() else None


def neighbours_among(blocks: Sequence[KnownBlock]) -> list[tuple[KnownBlock, KnownBlock]]:
    """Pairs whose ground meets, or that hold a photo of one name and size, in their order.

    A copy of a scan under another name is looked for on common ground only.
    """
    grounds = [shapely.union_all([*block.outlines.values()]) for block in blocks]
    tree = shapely.STRtree(grounds)
    pairs = {
        (one, other) for one, other in tree.query(grounds, "intersects").T.tolist() if one < other
    }
    holders: dict[tuple[str, tuple[int, int]], list[int]] = {}
    for number, block in enumerate(blocks):
        for name, (_, size) in block.scans.items():
            holders.setdefault((name, size), []).append(number)
    for numbers in holders.values():
        pairs |= set(combinations(numbers, 2))
    return [(blocks[one], blocks[other]) for one, other in sorted(pairs)]


def shared_photos(one: KnownBlock, other: KnownBlock) -> dict[str, str]:
    """Photos of both, by their name in the first: the same scan.

    Scans are the same by their bytes and a digest of their ends; where one of both cannot be read,
    by their name and size in pixels. Digests are only made where a scan of the other block has as
    many bytes.
    """
    common = set(one.held.values()) & set(other.held.values())
    there = {
        content_of(other.scans[name][0]): name
        for name, size in other.held.items()
        if size in common
    }
    found: dict[str, str] = {}
    for name, (path, pixels) in one.scans.items():
        match = there.get(content_of(path)) if one.held.get(name) in common else None
        unread = name not in one.held or name not in other.held
        if match is None and unread and name in other.scans and other.scans[name][1] == pixels:
            match = name
        if match is not None:
            found[name] = match
    return found


def namesakes(one: KnownBlock, other: KnownBlock, photos: Mapping[str, str]) -> list[str]:
    """Photos of one name and size in pixels whose scans are two files, as one saved again would be.

    Blocks whose ground is apart have such names by chance: none of them is told.

    Args:
        one: The first block.
        other: The second.
        photos: Those that are the same scan, by their name in the first.
    """
    known = {*photos, *photos.values()}
    alike = sorted(
        name
        for name, (_, pixels) in one.scans.items()
        if name not in known and name in other.scans and other.scans[name][1] == pixels
    )
    if not alike:
        return []
    tree = shapely.STRtree([*other.outlines.values()])
    return alike if tree.query([*one.outlines.values()], "intersects").size else []


def _bytes_of(scans: Mapping[str, tuple[Path, tuple[int, int]]]) -> dict[str, int]:
    """Bytes of the scans that are there."""
    return {name: path.stat().st_size for name, (path, _) in scans.items() if path.is_file()}


def _compared(one: KnownBlock, other: KnownBlock) -> Figures:
    """Figures of one pair; `why` says why it could not be compared."""
    named: dict[str, Any] = {"one": one.path, "other": other.path, "why": "", "told": 0}
    blank = {
        "rows": [],
        "one_sided": [],
        "namesakes": [],
        "measurements": 0,
        "correlation": 0.0,
        "same": True,
    }
    try:
        return {**named, **blank, **json_value(_pair_figures(one, other))}
    except PhotogrammetryError as error:
        return {**named, **blank, "why": error.told}


def _pair_figures(one: KnownBlock, other: KnownBlock) -> dict[str, Any]:
    photos = shared_photos(one, other)
    others = namesakes(one, other, photos)
    same = one.references == other.references or bool(one.references & other.references)
    common = bool(one.points & other.points)
    if not photos and not common and not (one.digests[1] and other.digests[1]):
        return {"same": same, "namesakes": others}
    sigma = 0.0 if same else hypot(_reference_sigma_m(one), _reference_sigma_m(other))
    moved = _moved(one, other)
    found = Comparison()
    if photos:
        found = compare_photos(_equations(one), _equations(other), photos, moved, sigma)
    reports = _report(one), _report(other)
    points = compare_points(reports[0], reports[1], moved, sigma)
    ground = None if photos else _common_ground((one, other), moved, sigma)
    whole = Comparison(
        found.photos, points, ground, found.measurements, found.correlation, found.one_sided
    )
    limits = [
        release_limit_m(report.block, block.project.rules)
        for report, block in zip(reports, (one, other), strict=True)
    ]
    rows = list(_rows(whole, min(limits)))
    return {
        "rows": rows,
        "told": sum(row["verdict"] == "disagree" for row in rows),
        "one_sided": list(whole.one_sided),
        "namesakes": others,
        "measurements": whole.measurements,
        "correlation": whole.correlation,
        "same": same,
        "limit_m": min(limits),
    }


def _rows(found: Comparison, limit_m: float) -> Iterator[dict[str, Any]]:
    """A row for each photo and point of both, and for their common ground."""
    by = found.compared, limit_m
    for photo in found.photos:
        yield _judged("photo", photo.photo_id, photo.difference, *by) | _of_photo(photo)
    for point in found.points:
        yield _judged("point", point.point_id, point.difference, *by) | _of_point(point)
    if found.ground is not None:
        yield _judged("ground", "", found.ground.difference, *by) | _of_ground(found.ground)


def _judged(
    kind: str, name: str, difference: Difference, compared: int, limit_m: float
) -> dict[str, Any]:
    return {
        "kind": kind,
        "name": name,
        "length_m": difference.length_m,
        "sigma_m": difference.sigma_m,
        "ratio": difference.ratio,
        "chance": difference.chance,
        "verdict": difference.verdict(compared, limit_m),
    }


def _of_photo(photo: SharedPhoto) -> dict[str, Any]:
    """Exterior orientation of the second block less that of the first."""
    return {
        "other_name": photo.other_id,
        "ground_m": photo.ground_m.mean(axis=0),
        "shift_m": photo.shift_m,
        "shift_sigma_m": photo.shift_sigma_m,
        "turn_deg": np.degrees(photo.turn),
        "turn_sigma_deg": np.degrees(photo.turn_sigma),
    }


def _of_point(point: SharedPoint) -> dict[str, Any]:
    return {
        "roles": point.roles,
        "shift_m": point.shift_m,
        "shift_sigma_m": point.sigma_m,
        "residuals_m": point.residuals_m,
        "sigmas_m": point.sigmas_m,
    }


def _of_ground(ground: SharedGround) -> dict[str, Any]:
    return {"shift_m": ground.shift_m, "rms_m": ground.rms_m, "places": ground.places}


def _least_likely(pair: Figures) -> tuple[bool, bool, float, str, str]:
    """Pairs that disagree first, then those that could not be compared."""
    chances = [row["chance"] for row in pair["rows"] if row["chance"] is not None]
    least = min(chances, default=1.0)
    return not pair["told"], not pair["why"], least, pair["one"], pair["other"]


@lru_cache(maxsize=KEPT_BLOCKS)
def _report(block: KnownBlock) -> AdjustmentReport:
    """The adjustment of a block.

    Raises:
        PhotogrammetryError: It is no longer there.
    """
    report = block.products.load_value("adjustment", block.digests[0])
    if not isinstance(report, AdjustmentReport):
        cause, remedy = "changed while blocks were compared.", "Compare again."
        raise PhotogrammetryError(block.project.folder, cause, remedy)
    return report


@lru_cache(maxsize=KEPT_BLOCKS)
def _equations(block: KnownBlock) -> NeighbourBlock:
    report = _report(block)
    # Heights of a DEM as observations are left out: what is predicted is then somewhat too large.
    return NeighbourBlock(report, influence_of(report, report.options or AdjustmentOptions()))


def _reference_sigma_m(block: KnownBlock) -> float:
    """Standard deviation per axis of a block's reference, metres; 0 without one."""
    reference = block.project.reference
    return reference.sigmas_m(block.project.block.crs)[0] if reference.ortho else 0.0


def _moved(one: KnownBlock, other: KnownBlock) -> Moved | None:
    """What brings the second block's coordinates into the CRS of the first; None for one CRS.

    Raises:
        CrsError: PROJ knows no way.
    """
    block: Block = _report(other).block
    places = np.array([photo.exterior.centre[:2] for photo in block.photos.values()])
    if same_coordinates(other.crs, one.crs, places):
        return None
    operation = operation_between(other.crs, one.crs, places, other.project.folder)

    def moved(points: ObjectPoints) -> ObjectPoints:
        return np.column_stack([operation.forward(points[:, :2]), points[:, 2]])

    return moved


def _common_ground(
    blocks: tuple[KnownBlock, KnownBlock], moved: Moved | None, sigma_m: float
) -> SharedGround | None:
    """Both mosaics by their misfits; None where one was not compared with its reference."""
    here, there = (block.products.load_value("misfit", block.digests[1]) for block in blocks)
    if here is None or there is None:
        return None
    one, other = cast("Misfit", here[1]), cast("Misfit", there[1])
    return compare_misfits(
        _misfit_parts(one, _reference_sigma_m(blocks[0]), None),
        _misfit_parts(other, _reference_sigma_m(blocks[1]), moved),
        min(_spacing_m(one), _spacing_m(other)),
        sigma_m,
    )


def _misfit_parts(misfit: Misfit, reference_sigma_m: float, moved: Moved | None) -> MisfitParts:
    """What is compared of a misfit: vectors that are right and whose photo was adjusted."""
    vectors = misfit.vectors
    sound = vectors.found & np.isfinite(vectors.predicted_sigmas_m).all(axis=1)
    positions, shifts = vectors.positions[sound], vectors.shifts_m[sound]
    if moved is not None:
        ends = _in_plane(moved, positions + shifts)
        positions = _in_plane(moved, positions)
        shifts = ends - positions
    own = vectors.predicted_sigmas_m[sound] ** 2 - reference_sigma_m**2
    return MisfitParts(positions, shifts, np.maximum(own, 0.0))


def _in_plane(moved: Moved, places: np.ndarray) -> np.ndarray:
    return moved(np.column_stack([places, np.zeros(len(places))]))[:, :2]


def _spacing_m(misfit: Misfit) -> float:
    """Distance of the places that were tried, metres."""
    places = misfit.vectors.positions
    extent = np.ptp(places, axis=0) if len(places) else np.zeros(2)
    return float(np.sqrt(extent.prod() / max(misfit.vectors.tried, 1)))


def archive_of(folder: Path) -> Archive:
    """The blocks below a folder.

    Raises:
        PhotogrammetryError: There are none, there is no such folder, or it is a block itself.
    """
    remedy = "Name a folder with blocks in it that were run."
    if not folder.exists():
        raise PhotogrammetryError(folder, "does not exist.", remedy)
    if (folder.parent if folder.name == FILE else folder).joinpath(FILE).is_file():
        raise PhotogrammetryError(folder, "is a block.", "Name the folder above it.")
    if not folder.is_dir():
        raise PhotogrammetryError(folder, "is no folder.", remedy)
    if not any(was_made(folder / path, "control") for path in blocks_in(folder)):
        raise PhotogrammetryError(folder, "holds no block that was run.", remedy)
    return Archive(folder)
