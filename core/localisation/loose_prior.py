"""Remove the georeference from photos that were found on the reference.

A georeference that is hundreds of metres off would bias the adjustment and widen the search for
pairs and points. Once a photo has been found on the reference, it keeps only what holds for any
aerial photo: it was taken nearly vertically, from where its own picture says.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from core.adjustment.positioning import MEASURED_M
from core.block import Block, ExteriorPrior, Photo, ground_of
from core.geometry.crs import Bounds
from core.geometry.exterior import ExteriorOrientation
from core.georeference.approximation import TILT
from core.georeference.archive import UNDER_M

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
