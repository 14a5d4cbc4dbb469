"""What GNSS and IMU get wrong the same way in many photos: shift, drift, misalignment.

Measured centre = perspective centre + shift + drift times the place along the strip (-1 to 1);
measured rotation = R exp[m] with the misalignment m about the image axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.strips import places_along, strips_of
from core.block import Photo
from core.geometry.camera import Camera

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
