"""Priors in localisation: presumed principal distances, and the georeference that is removed.

A georeference that is hundreds of metres off would bias the adjustment and widen the search for
pairs and points. Once a photo has been found on the reference, it keeps only what holds for any
aerial photo: it was taken nearly vertically, from where its own picture says.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from core.adjustment.positioning import MEASURED_M
from core.block import Block, ExteriorPrior, Photo, ground_of
from core.geometry.crs import Bounds
from core.geometry.exterior import ExteriorOrientation
from core.georeference.approximation import TILT, Approximation
from core.georeference.archive import UNDER_M
from core.georeference.stage import Georeferenced

# design: relief under one photo; it is to have no say against measurements.
HEIGHT_SHARE = 0.03
"""Standard deviation of the height over ground, as a share of it."""


def free_from_archive(
    block: Block, clicked: frozenset[str], mean_height: Callable[[Bounds], float]
) -> Block:
    """The block with loose priors about where its photos stand.

    Photos that do not stand, that were placed by clicks, or whose perspective centre was measured
    in flight keep what is known of them.

    Args:
        block: Photos with their orientations; those that stand are `oriented`.
        clicked: Photos placed by clicks.
        mean_height: Mean height of the ground within bounds, metres; NaN where there is none.
    """
    photos = {
        name: _with_loose_prior(photo, block, mean_height)
        if name not in clicked and _stands_unmeasured(photo)
        else photo
        for name, photo in block.photos.items()
    }
    return block.with_photos(photos)


def _stands_unmeasured(photo: Photo) -> bool:
    """Whether a photo stands, and nothing better than a georeference says where."""
    return photo.oriented and bool(np.any(photo.prior.sigma_centre_m > MEASURED_M))


def _with_loose_prior(photo: Photo, block: Block, mean_height: Callable[[Bounds], float]) -> Photo:
    """A photo as a vertical one over the ground it shows, with what that leaves open."""
    camera = block.camera_of(photo.photo_id)
    middle_px = photo.interior.pixel_from_film(np.array([camera.principal_point_mm]))
    east, north = (float(value) for value in ground_of(photo, camera, middle_px)[0, :2])
    height = mean_height((east - UNDER_M, north - UNDER_M, east + UNDER_M, north + UNDER_M))
    ground = photo.ground_height_m if np.isnan(height) else height
    above = float(photo.exterior.centre[2]) - ground
    vertical = ExteriorOrientation(
        np.array([east, north, ground + above]), 0.0, 0.0, photo.exterior.kappa
    )
    plan = above * TILT
    prior = ExteriorPrior(
        np.array([plan, plan, HEIGHT_SHARE * above]), np.array([TILT, TILT, TILT])
    )
    return replace(photo, approximate=vertical, prior=prior, ground_height_m=ground)


def at_distances(placed: Georeferenced, chosen: Mapping[str, int]) -> Georeferenced:
    """The photos as the archive places them, their cameras at some principal distances.

    What tells the scale of a photo leaves it over the same ground, seen from another height; a
    listed perspective centre stays.

    Args:
        placed: The photos with the principal distances that were proposed first.
        chosen: By camera, which of its `distances_mm` is taken.
    """
    block = placed.block
    cameras = {
        name: camera.at_distance(*camera.distances_mm[chosen[name]]) if name in chosen else camera
        for name, camera in block.cameras.items()
    }
    photos: dict[str, Photo] = {}
    approximations: dict[str, Approximation] = {}
    for name, photo in block.photos.items():
        before, now = block.cameras[photo.camera], cameras[photo.camera]
        ratio = now.principal_distance_mm / before.principal_distance_mm
        known = placed.approximations[name]
        if known.source == "exterior":
            ratio = 1.0
        ground = photo.ground_height_m
        prior = _stretched(known.prior, ratio)
        photos[name] = replace(
            photo,
            exterior=_lifted(photo.exterior, ground, ratio),
            approximate=_lifted(photo.approximate, ground, ratio),
            prior=prior,
        )
        approximations[name] = replace(
            known,
            exterior=_lifted(known.exterior, ground, ratio),
            prior=prior,
            hypotheses=tuple(_lifted(one, ground, ratio) for one in known.hypotheses),
        )
    block = replace(block, cameras=cameras, photos=photos)
    return replace(placed, block=block, approximations=approximations)


def _lifted(exterior: ExteriorOrientation, ground_m: float, ratio: float) -> ExteriorOrientation:
    """An orientation so many times as high above the ground."""
    centre = exterior.centre.copy()
    centre[2] = ground_m + ratio * (centre[2] - ground_m)
    return replace(exterior, centre=centre)


def _stretched(prior: ExteriorPrior, ratio: float) -> ExteriorPrior:
    """The height so many times as unsure."""
    return replace(prior, sigma_centre_m=prior.sigma_centre_m * np.array([1.0, 1.0, ratio]))
