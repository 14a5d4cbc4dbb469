"""Common errors of GNSS and IMU: shift, drift, misalignment.

Measured centre = perspective centre + shift + drift times the place along the strip (-1 to 1);
measured rotation = R exp[m] with the misalignment m about the image axes. Flight strips are found
from the positions of the photos.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int

from core.adjustment.adjusted import AdjustmentOptions
from core.block import Photo
from core.geometry.camera import Camera
from core.geometry.crs import PlanePoints
from core.geometry.robust import TINY

# design: no archive knows a centre to ten metres, every receiver in flight does.
MEASURED_M = 10.0
"""Centres known at least this well (metres, every axis) were measured in flight."""
# design: no archive knows an angle to a degree, every IMU does.
MEASURED_RAD = np.radians(1.0)
"""Angles known at least this well were."""
# design: no receiver is further off.
LOOSE_M = 1000.0
"""Prior of a shift or drift, metres: keeps the equations regular, no more."""
# design: no mount is turned by more than ten degrees.
LOOSE_RAD = 0.2
"""Prior of a misalignment, radians."""
AXES = "XYZ"
# design: crab differs by a few degrees within a strip, strips by 180 or 90.
TURNED = np.radians(20.0)
"""Photos whose kappa differs by more than this are not of one strip."""
# design: half of what lies between strips at 30 % side overlap.
ACROSS = 0.35
"""A photo further off a strip's line than this share of the photo's side is not of it."""
# design: photos that overlap are less than one side apart; a fifth for tilt.
GAP = 1.2
"""Nor one further along it than this many sides from its neighbour: there is no overlap."""


@dataclass(frozen=True, slots=True, eq=False)
class Positioning:
    """The unknowns that the measured orientations of many photos share."""

    owners: tuple[str, ...]
    """Block or strip of each unknown."""
    names: tuple[str, ...]
    """What each is called, with its unit."""
    by_centre: Float64[np.ndarray, "photos 3 unknowns"]
    """Measured centres by the unknowns (metres per metre)."""
    turned: Bool[np.ndarray, "photos"]
    """Photos whose angles were measured."""
    misaligned: bool
    """True when the last three unknowns are the misalignment."""
    weights: Float64[np.ndarray, "unknowns"]
    """Roots of the weights of their priors about nought."""

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.names)


def positioning_of(
    photos: Sequence[Photo], cameras: Sequence[Camera], options: AdjustmentOptions
) -> Positioning:
    """Which unknowns the measured centres and angles of some photos share.

    Args:
        photos: The photos.
        cameras: The camera of each.
        options: Which are wanted; those no photo can tell anything of are left out.
    """
    centres = np.array([photo.prior.sigma_centre_m for photo in photos]).reshape(-1, 3)
    angles = np.array([photo.prior.sigma_angles for photo in photos]).reshape(-1, 3)
    measured = np.asarray((centres <= MEASURED_M).all(axis=1))
    turned = np.asarray((angles <= MEASURED_RAD).all(axis=1))
    owners: list[str] = []
    names: list[str] = []
    columns: list[Float64[np.ndarray, "photos 3"]] = []
    if options.gnss_shift != "none" and measured.any():
        for owner, shares in _groups(photos, cameras, options.gnss_shift, measured):
            inside = np.isfinite(shares)
            drifts = options.gnss_drift and float(np.ptp(shares[inside])) > 0
            parts = ("shift", "drift") if drifts else ("shift",)
            for part in parts:
                values = np.where(inside, 1.0 if part == "shift" else np.nan_to_num(shares), 0.0)
                for axis in range(3):
                    columns.append(values[:, None] * np.eye(3)[axis])
                    names.append(f"gnss_{part}_{AXES[axis]}_m")
                    owners.append(owner)
    misaligned = options.misalignment and bool(turned.any())
    weights = [1 / LOOSE_M] * len(names)
    if misaligned:
        names += [f"misalignment_{axis}_deg" for axis in "xyz"]
        owners += ["block"] * 3
        columns += [np.zeros((len(photos), 3))] * 3
        weights += [1 / LOOSE_RAD] * 3
    by_centre = np.stack(columns, axis=2) if columns else np.zeros((len(photos), 3, 0))
    return Positioning(
        tuple(owners), tuple(names), by_centre, turned, misaligned, np.array(weights)
    )


def _groups(
    photos: Sequence[Photo],
    cameras: Sequence[Camera],
    per: str,
    measured: Bool[np.ndarray, "photos"],
) -> list[tuple[str, Float64[np.ndarray, "photos"]]]:
    """Each group's name with the place of its photos along it, NaN for all others."""
    if per == "block":
        places = places_along(photos, np.zeros(len(photos), dtype=np.int64))
        return [("block", np.where(measured, places, np.nan))]
    sides = [
        min(camera.frame_mm)
        / camera.principal_distance_mm
        * abs(float(photo.approximate.centre[2]) - photo.ground_height_m)
        for photo, camera in zip(photos, cameras, strict=True)
    ]
    strips = strips_of(photos, sides)
    places = places_along(photos, strips)
    return [
        (f"strip {number + 1}", np.where(measured & (strips == number), places, np.nan))
        for number in np.unique(strips[measured]).tolist()
    ]


def strips_of(photos: Sequence[Photo], sides_m: Sequence[float]) -> Int[np.ndarray, "photos"]:
    """Number of the strip of each photo, counted from 0 in the order of first photos.

    Args:
        photos: Photos with their orientations.
        sides_m: Side of the ground each photo shows, metres.
    """
    centres = _plan_centres(photos)
    kappas = np.array([photo.exterior.kappa for photo in photos])
    sides = np.asarray(sides_m, dtype=np.float64)
    numbers = np.full(len(photos), -1, dtype=np.int64)
    headings = kappas + _strip_axis(centres, kappas)
    for index in range(len(photos)):
        if numbers[index] < 0:
            number = int(numbers.max()) + 1
            _grow(index, number, numbers, centres, headings=headings, sides=sides)
    return numbers


def _strip_axis(
    centres: Float64[np.ndarray, "photos 2"], kappas: Float64[np.ndarray, "photos"]
) -> float:
    """0 where strips run along the film's x axis, a quarter turn where along y.

    Scans may lie a quarter turned; most photos' next neighbour tells.
    """
    votes = 0
    for here in range(len(centres)):
        turn = np.abs(np.remainder(kappas - kappas[here] + np.pi, 2 * np.pi) - np.pi)
        offset = centres - centres[here]
        distance = np.where(turn < TURNED, np.linalg.norm(offset, axis=1), np.inf)
        distance[here] = np.inf
        if not np.isfinite(distance).any():
            continue
        towards = offset[int(np.argmin(distance))]
        along = towards @ [np.cos(kappas[here]), np.sin(kappas[here])]
        across = towards @ [-np.sin(kappas[here]), np.cos(kappas[here])]
        votes += 1 if abs(along) >= abs(across) else -1
    return 0.0 if votes >= 0 else float(np.pi / 2)


def _grow(
    start: int,
    number: int,
    numbers: Int[np.ndarray, "photos"],
    centres: Float64[np.ndarray, "photos 2"],
    *,
    headings: Float64[np.ndarray, "photos"],
    sides: Float64[np.ndarray, "photos"],
) -> None:
    """Give the strip's number to all photos that follow one another in its direction."""
    waiting = [start]
    numbers[start] = number
    while waiting:
        here = waiting.pop()
        offset = centres - centres[here]
        turn = np.abs(np.remainder(headings - headings[here] + np.pi, 2 * np.pi) - np.pi)
        along = offset @ [np.cos(headings[here]), np.sin(headings[here])]
        across = offset @ [-np.sin(headings[here]), np.cos(headings[here])]
        follows = (np.abs(along) < GAP * sides[here]) & (np.abs(across) < ACROSS * sides[here])
        for other in np.flatnonzero((turn < TURNED) & (numbers < 0) & follows).tolist():
            numbers[other] = number
            waiting.append(other)


def _plan_centres(photos: Sequence[Photo]) -> PlanePoints:
    """Easting and northing of the perspective centres."""
    return np.array([photo.exterior.centre[:2] for photo in photos]).reshape(-1, 2)


def places_along(
    photos: Sequence[Photo], strips: Int[np.ndarray, "photos"]
) -> Float64[np.ndarray, "photos"]:
    """Place of each photo along its strip, -1 at the first to +1 at the last; 0 when alone."""
    centres = _plan_centres(photos)
    places = np.zeros(len(photos))
    for number in np.unique(strips).tolist():
        members = np.flatnonzero(strips == number)
        if len(members) < 2:
            continue
        offset = centres[members] - centres[members].mean(axis=0)
        direction = np.linalg.svd(offset, full_matrices=False)[2][0]
        along = offset @ direction
        half = (along.max() - along.min()) / 2
        places[members] = (along - along.min()) / max(half, TINY) - 1
    return places
