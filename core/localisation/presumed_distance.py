"""A block whose cameras use one of several presumed principal distances."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from core.block import ExteriorPrior, Photo
from core.geometry.exterior import ExteriorOrientation
from core.georeference.approximation import Approximation
from core.georeference.stage import Georeferenced


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
