"""The blocks of the benchmarks: as in the published comparison of programs.

200 rays a photo, about 2.8 rays a point, 30 control points (0.5, 0.5, 1 m), priors of 20 m, start
20 m and 1 degree off, c, x0, y0, k1, k2 estimated.
"""

from dataclasses import replace

import numpy as np

from core.block import Block, Photo
from core.geometry.collinearity import Atmosphere
from tests.flights import FlightPlan, fly

LOOSE_RAD = 100.0
"""Prior of angles that has no say: Ceres has none."""


class VacuumPhoto(Photo):
    """A photo without refraction and curvature, which the peers do not model."""

    @property
    def atmosphere(self) -> Atmosphere:
        return Atmosphere()


def sized(strips: int, photos_per_strip: int, rays_per_photo: int = 200) -> FlightPlan:
    """A block of strips with 60 % and 30 % overlap and about so many tie rays in each photo."""
    photos = strips * photos_per_strip
    # About 3.5 photos show a point at these overlaps, 2.8 are kept.
    return FlightPlan(
        strips=strips,
        photos_per_strip=photos_per_strip,
        ties=round(photos * rays_per_photo / 2.45),
        control=30,
        check=0,
        control_sigma_m=(0.5, 0.5, 1.0),
        start_m=20.0,
        start_rad=np.radians(1.0),
        side=0.3,
        most_rays=3,
    )


def comparable(strips: int, photos_per_strip: int, seed: int) -> Block:
    """The same for us and the peers: no atmosphere, angles without a prior."""
    block = fly(sized(strips, photos_per_strip), np.random.default_rng(seed)).block
    photos = {
        name: VacuumPhoto(
            name,
            photo.scan,
            photo.size_px,
            photo.camera,
            photo.interior,
            photo.exterior,
            photo.approximate,
            replace(photo.prior, sigma_angles=np.full(3, LOOSE_RAD)),
            photo.ground_height_m,
            photo.oriented,
        )
        for name, photo in block.photos.items()
    }
    return replace(block, photos=photos)
