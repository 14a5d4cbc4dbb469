"""Pairs of photos that may show the same ground, from their approximate orientation."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from shapely import Polygon, contains_xy, prepare

from core.arrays import Flags, ObjectPoints, PixelPoints
from core.block.block import Block, Photo
from core.geometry.camera import Camera


@dataclass(frozen=True, slots=True)
class PairOptions:
    """Which pairs are tried."""

    min_overlap: float = 0.05
    """Share of the smaller footprint that two footprints must have in common."""
    sigmas: float = 2.0
    """Footprints grow by this many standard deviations of the photos' relative position."""
    max_growth: float = 0.5
    """They never grow by more than this share of the smaller footprint's side."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePair:
    """Two photos that may overlap."""

    first: str
    """Photo whose name comes first."""
    second: str
    """The other photo."""
    overlap: float
    """Expected common share of the smaller footprint, 0 to 1, without any growth."""
    first_region: Polygon | None
    """Where the second photo may be seen on the ground of the first one, metres; None: anywhere."""
    second_region: Polygon | None
    """Where the first photo may be seen on the ground of the second one, metres; None: anywhere."""


def footprint(photo: Photo, camera: Camera) -> Polygon:
    """Ground of a photo's picture area at its mean height, easting and northing, metres."""
    corners = photo.interior.pixel_from_film(camera.frame_corners_mm)
    return Polygon(ground_of(photo, camera, corners)[:, :2])


def ground_of(photo: Photo, camera: Camera, pixels: PixelPoints) -> ObjectPoints:
    """Scan pixels on the mean ground, along the orientation that is the best known now."""
    heights = np.full(len(pixels), photo.ground_height_m)
    return photo.object_from_pixel(pixels, heights, camera)


def find_pairs(block: Block, options: PairOptions | None = None) -> tuple[CandidatePair, ...]:
    """All pairs of a block whose footprints may overlap, by name.

    Positions may be hundreds of metres off: a pair is tried when its footprints, grown by the
    standard deviations of the photos' positions, have the wanted share in common. Where positions
    are not known to a footprint every pair is tried, and no overlap is expected of it.
    """
    options = options or PairOptions()
    prints = {name: footprint(photo, block.camera_of(name)) for name, photo in block.photos.items()}
    found: list[CandidatePair] = []
    for first, second in combinations(sorted(block.photos), 2):
        ours, theirs = prints[first], prints[second]
        smaller = min(ours.area, theirs.area)
        if smaller <= 0:
            continue
        if _sigma_m(block, first, second) > np.sqrt(smaller):
            found.append(CandidatePair(first, second, 0.0, None, None))
            continue
        growth = _growth_m(block, first, second, options, float(np.sqrt(smaller)))
        if ours.distance(theirs) > growth:
            continue
        second_grown, first_grown = theirs.buffer(growth), ours.buffer(growth)
        if ours.intersection(second_grown).area / smaller < options.min_overlap:
            continue
        found.append(
            CandidatePair(
                first,
                second,
                float(ours.intersection(theirs).area / smaller),
                second_grown,
                first_grown,
            )
        )
    return tuple(found)


def within(region: Polygon, points: ObjectPoints) -> Flags:
    """True for ground points inside a region."""
    prepare(region)
    return np.asarray(contains_xy(region, points[:, 0], points[:, 1]), dtype=np.bool_)


def position_sigma_m(photo: Photo) -> float:
    """Standard deviation of a footprint's place on the ground, metres: position and tilt."""
    height = abs(float(photo.exterior.centre[2]) - photo.ground_height_m)
    plane = float(np.max(photo.prior.sigma_centre_m[:2]))
    tilt = height * float(np.max(photo.prior.sigma_angles[:2]))
    return float(np.hypot(plane, tilt))


def _growth_m(block: Block, first: str, second: str, options: PairOptions, side_m: float) -> float:
    """By how much footprints grow before they are compared."""
    sigma = _sigma_m(block, first, second)
    return min(options.sigmas * sigma, options.max_growth * side_m)


def _sigma_m(block: Block, first: str, second: str) -> float:
    """Standard deviation of the relative position of two footprints, metres."""
    one, other = (position_sigma_m(block.photos[name]) for name in (first, second))
    return float(np.hypot(one, other))
