"""The sheets of an ortho or a DEM together: on common pixel lattices, the finest first.

Sheets of one pixel size and phase share a lattice, on which neighbours join without a seam: a
resampling kernel that crosses a sheet edge finds the neighbour's pixels there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64
from pyproj import CRS

from core.arrays import Affine2, locked
from core.doubts import Doubt
from core.errors import ReferenceDataError
from core.frames import HALF_PIXEL
from core.geometry.crs import Bounds, Operation, operation_between, short_name
from core.raster.sheets import Sheet, SheetKind, block_outline, open_sheet

PHASE_TOLERANCE_PX = 0.02
"""Origins that differ from whole pixels by less than this lie on one lattice."""
# design: a fiftieth of a pixel, what rounded world files leave; nothing here is measured as well.
SIZE_TOLERANCE = 1e-6
"""Relative difference below which two pixel sizes are one."""
# design: a hundredth of a pixel over a sheet of ten thousand.
HALF_TOLERANCE_PX = 0.05
"""Sheets this near to half a pixel beside others are told."""
# design: coarser than `PHASE_TOLERANCE_PX`, since it only makes a note.


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Sheets whose pixels fall on one and the same raster, of any extent."""

    sheets: tuple[Sheet, ...]
    """The sheets, in the order of their files; where two overlap the first is taken."""
    offsets: Int64[np.ndarray, "sheets 2"]
    """Column and row of each sheet's first pixel on the lattice."""
    plane_from_lattice: Affine2
    """Coordinates in the lattice's CRS from lattice columns and rows."""
    operation: Operation | None
    """From the CRS of the sheets to the block's; None where they give the same coordinates."""
    ground_sample_distance_m: float
    """Size of a pixel on the ground, metres."""
    key: str
    """Names the files in their present state, for what is remembered of them."""

    @property
    def north_up(self) -> bool:
        """Whether rows run east and columns south in the block's CRS."""
        (a, b, _), (d, e, _) = self.plane_from_lattice
        slant = abs(b) + abs(d)
        return self.operation is None and a > 0 > e and bool(slant < 1e-9 * (a - e))


@dataclass(frozen=True, slots=True, eq=False)
class SheetSet:
    """All sheets of an ortho or a DEM: finest lattice first."""

    crs: str
    """The block's CRS."""
    lattices: tuple[Lattice, ...]
    """Groups of sheets, finest pixels first."""
    bounds: Bounds
    """West, south, east, north over all sheets, in the block's CRS, metres."""
    notes: tuple[Doubt, ...]
    """What the operator should know, such as sheets reprojected on the fly."""

    @property
    def sheets(self) -> tuple[Sheet, ...]:
        """Every sheet."""
        return tuple(sheet for lattice in self.lattices for sheet in lattice.sheets)

    @property
    def key(self) -> tuple[str, ...]:
        """Names the files in their present state, for what is remembered of them."""
        return (self.crs, *(lattice.key for lattice in self.lattices))


def open_sheets(paths: Sequence[str | Path], crs: CRS, what: SheetKind) -> SheetSet:
    """Look at every file once: size, place, bands, mask, collar; nothing stays open.

    Args:
        paths: GeoTIFF, JPEG 2000, JPEG with world file: whatever GDAL reads.
        crs: The block's CRS.
        what: What the files hold, for messages; only orthos have collars.
    """
    if not paths:
        raise ReferenceDataError(
            f"[reference] {what.lower()}", f"no {what} is given.", "Name at least one file."
        )
    # Each file once, whatever globs overlap; sorted, so that the result hangs on no order.
    sheets = [open_sheet(path, crs, what) for path in sorted({str(path) for path in paths})]
    sheets = _with_operations(sheets, crs)
    lattices = sorted(_lattices(sheets), key=lambda g: g.ground_sample_distance_m)
    corners = np.vstack([block_outline(sheet) for sheet in sheets])
    low, high = corners.min(axis=0), corners.max(axis=0)
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    notes = (*_notes(sheets, crs, what), *_half_pixel_notes(lattices, what))
    return SheetSet(crs.to_wkt(), tuple(lattices), bounds, notes)


def _with_operations(sheets: Sequence[Sheet], crs: CRS) -> list[Sheet]:
    """Sheets of one CRS all go the same way to the block's."""
    result = [sheet for sheet in sheets if not sheet.crs]
    for own in sorted({sheet.crs for sheet in sheets if sheet.crs}):
        members = [sheet for sheet in sheets if sheet.crs == own]
        corners = np.vstack([sheet.corners() for sheet in members])
        operation = operation_between(own, crs.to_wkt(), corners, members[0].path)
        result += [replace(sheet, operation=operation) for sheet in members]
    return sorted(result, key=lambda sheet: sheet.path)


def _notes(sheets: Sequence[Sheet], crs: CRS, what: str) -> tuple[Doubt, ...]:
    """One note for every other CRS among the sheets."""
    notes: list[Doubt] = []
    for own in sorted({sheet.crs for sheet in sheets if sheet.crs}):
        files = [sheet.path for sheet in sheets if sheet.crs == own]
        operation = next(sheet.operation for sheet in sheets if sheet.crs == own)
        assert operation is not None
        accuracy, lossless = operation.accuracy_m, operation.accuracy_m == 0
        known = "of unknown accuracy" if np.isnan(accuracy) else f"good to {accuracy:g} m"
        lack = "" if operation.best else " A better operation needs a grid that is not installed."
        notes.append(
            Doubt(
                kind="reference-reprojected",
                subject=files[0],
                message=f"{len(files)} {what} sheet(s) in {short_name(CRS(own))} are reprojected "
                f"to {short_name(crs)} while reading ({operation.words}, "
                f"{'without loss' if lossless else known}).{lack}",
                gravity=0.2 if operation.best else 0.5,
                evidence={"files": files, "accuracy_m": None if np.isnan(accuracy) else accuracy},
            )
        )
    return tuple(notes)


def _half_pixel_notes(lattices: Sequence[Lattice], what: str) -> list[Doubt]:
    """Sheets half a pixel beside their fellows: some world files mean the corner (METHODS 10)."""
    notes: list[Doubt] = []
    for index, lattice in enumerate(lattices):
        for other in lattices[:index]:
            one, two = other.sheets[0], lattice.sheets[0]
            if one.crs != two.crs or not _same_size(one, two):
                continue
            phase = _offset(one, two) % 1
            if np.abs(phase - HALF_PIXEL).max() < HALF_TOLERANCE_PX:
                files = [sheet.path for sheet in lattice.sheets]
                notes.append(
                    Doubt(
                        kind="reference-half-pixel",
                        subject=files[0],
                        message=f"{len(files)} {what} sheet(s) lie half a pixel "
                        f"({lattice.ground_sample_distance_m / 2:g} m) beside the others: the "
                        "world files of one kind seem to mean the corner of the first pixel, not "
                        "its centre. Sheets cut before 2016 may do so.",
                        gravity=0.4,
                        evidence={"files": files, "beside": one.path},
                    )
                )
    return notes


def _lattices(sheets: Sequence[Sheet]) -> list[Lattice]:
    """Group the sheets by CRS, pixel size and phase."""
    groups: list[list[Sheet]] = []
    for sheet in sheets:
        home = next((g for g in groups if _share_lattice(g[0], sheet)), None)
        groups.append([sheet]) if home is None else home.append(sheet)
    return [_lattice(group) for group in groups]


def _share_lattice(one: Sheet, other: Sheet) -> bool:
    """Whether the pixels of two sheets fall on one raster."""
    if one.crs != other.crs or one.bands != other.bands or not _same_size(one, other):
        return False
    offset = _offset(one, other)
    return bool(np.abs(offset - np.round(offset)).max() < PHASE_TOLERANCE_PX)


def _same_size(one: Sheet, other: Sheet) -> bool:
    """Whether the pixels of two sheets are of one size and lie the same way."""
    linear = one.plane_from_pixel[:, :2]
    difference = np.abs(other.plane_from_pixel[:, :2] - linear).max()
    return bool(difference <= SIZE_TOLERANCE * np.abs(linear).max())


def _offset(one: Sheet, other: Sheet) -> Float64[np.ndarray, "2"]:
    """Column and row of the other sheet's first pixel in pixels of the one."""
    shift = other.plane_from_pixel[:, 2] - one.plane_from_pixel[:, 2]
    return np.linalg.solve(one.plane_from_pixel[:, :2], shift)


def _lattice(group: Sequence[Sheet]) -> Lattice:
    """One lattice, counted from the first pixel of its first sheet."""
    first = group[0]
    files = repr([(sheet.path, sheet.stamp, sheet.bands) for sheet in group])
    outline = block_outline(first)
    east, north = outline.T
    area = 0.5 * abs(float(np.sum(east * np.roll(north, -1) - np.roll(east, -1) * north)))
    return Lattice(
        sheets=tuple(group),
        offsets=locked(np.round([_offset(first, sheet) for sheet in group]), np.int64),
        plane_from_lattice=first.plane_from_pixel,
        operation=first.operation,
        ground_sample_distance_m=float(np.sqrt(area / (first.columns * first.rows))),
        key=blake2b(files.encode(), digest_size=16).hexdigest(),
    )
