"""Nadir, isocentre, principal point and fiducial centre of a photo, and what moves its points."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from core.arrays import ObjectPoints, PixelPoints
from core.block import Block
from core.geometry.image_corrections import ImageShift, SpecialPoint, shifts_at, special_points
from core.geometry.resection import PhotoModel
from ui.review.compare import (
    DrawnPhoto,
    HeightSource,
    PlanePoints,
    ground_from_pixel,
    pixel_from_ground,
)
from ui.review.looks import round_all, short

LETTERS: dict[SpecialPoint, str] = {
    "nadir": "N", "isocentre": "I", "principal": "H", "fiducial_centre": "M",
}  # fmt: skip
"""What stands beside them in scene and scan."""
Frame = Literal["scan", "ground"]
"""Pixels of the raw scan, or metres east and north as its warped picture has them."""


def letters_of(block: Block) -> list[str]:
    """Letters of the points that photos of a block have."""
    marked = any(camera.fiducials_mm for camera in block.cameras.values())
    return [letter for name, letter in LETTERS.items() if name != "fiducial_centre" or marked]


def model_of(drawn: DrawnPhoto) -> PhotoModel:
    """What the engine knows of a photo beside its exterior orientation."""
    photo = drawn.photo
    return PhotoModel(photo.interior, drawn.camera, photo.atmosphere)


def special_pixels(drawn: DrawnPhoto) -> Mapping[SpecialPoint, PixelPoints]:
    """The points in the raw scan, (1, 2) pixels."""
    interior = drawn.photo.interior
    found = special_points(model_of(drawn), drawn.photo.exterior)
    return {name: interior.pixel_from_film(film) for name, film in found.items()}


def special_grounds(drawn: DrawnPhoto, dem: HeightSource) -> Mapping[str, ObjectPoints]:
    """Where the points' rays meet the ground, by letter, (1, 3) metres; finite ones."""
    pixels = special_pixels(drawn)
    grounds = ground_from_pixel(
        np.vstack(list(pixels.values())), drawn, dem, drawn.photo.ground_height_m
    )
    pairs = zip(pixels, grounds, strict=True)
    return {LETTERS[name]: place[None] for name, place in pairs if np.isfinite(place).all()}


def special_part(drawn: DrawnPhoto, dem: HeightSource) -> list[list[Any]]:
    """Letter, pixel of the raw scan, and metres east and north of each."""
    grounds = special_grounds(drawn, dem)
    return [
        [LETTERS[name], round_all(pixel[0], 2), round_all(grounds[LETTERS[name]][0, :2], 3)]
        for name, pixel in special_pixels(drawn).items()
        if LETTERS[name] in grounds
    ]


def corrections_part(
    drawn: DrawnPhoto, dem: HeightSource, frame: Frame, place: PlanePoints
) -> list[list[Any]]:
    """What moved the image point at a place (1, 2): effect, micrometres, pixels, metres.

    Micrometres and pixels are negative where the point was moved towards the principal point; the
    last row is all effects together. Empty beside the scan, and where no ray meets the ground.
    """
    photo, model = drawn.photo, model_of(drawn)
    pixel = place if frame == "scan" else pixel_from_ground(place, drawn, dem)
    ground = ground_from_pixel(pixel, drawn, dem, photo.ground_height_m)
    inside = (pixel >= 0).all() and (pixel <= np.array(photo.size_px)).all()
    if not inside or not np.isfinite(ground).all():
        return []
    shifts = shifts_at(pixel, ground[:, 2], model, photo.exterior)
    middle = special_points(model, photo.exterior)["principal"]
    away = photo.interior.film_from_pixel(pixel) - middle
    none = ImageShift(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 3)))
    rows = {**shifts, "together": sum(shifts.values(), none)}
    return [
        [
            name,
            short(1000 * shift.sign(away) * float(np.linalg.norm(shift.film_mm)), 2),
            short(shift.sign(away) * float(np.linalg.norm(shift.pixel_px)), 3),
            short(float(np.linalg.norm(shift.ground_m)), 3),
        ]
        for name, shift in rows.items()
    ]
