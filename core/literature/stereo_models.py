"""Photogrammetric models: two photos in each other's right place, with the points both show."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Int

from core.arrays import Flags, Indices, ObjectPoints, PixelPoints, Rotation
from core.block import Block, Photo
from core.doubts import Failure
from core.geometry.relative import (
    Rays,
    RelativeOptions,
    model_depths,
    orient_relative,
    relative_from_exteriors,
)
from core.ties.matches import ray_pairs

LEAST_COMMON = 12
"""Two photos with fewer common points are no model."""
OPTIONS = RelativeOptions(tolerance_px=4.0, min_inliers=10)
"""Points are measured by now, and their errors known: wrong ones stand far out."""


@dataclass(frozen=True, slots=True, eq=False)
class Sights:
    """All points of a block under one count: tie points, control, then perspective centres."""

    numbers: Mapping[str, Indices]
    """By photo, the points it shows."""
    pixels: Mapping[str, PixelPoints]
    """Where, scan pixels."""
    control: Mapping[int, str]
    """Names of the control points among them."""
    centres: Mapping[str, int]
    """Number of each photo's perspective centre."""

    @staticmethod
    def of(block: Block) -> "Sights":
        """Ties and used control; check points are left out."""
        names = sorted(name for name, point in block.surveyed.items() if point.role == "control")
        number = {name: block.ties.count + i for i, name in enumerate(names)}
        numbers, pixels = {}, {}
        for photo_id in block.photos:
            known = photo_id in block.ties.photo_ids
            rays = np.flatnonzero(
                block.ties.photo == (block.ties.photo_ids.index(photo_id) if known else -1)
            )
            measured = [
                m
                for m in block.measurements.values()
                if m.photo_id == photo_id and m.used and m.point_id in number
            ]
            places = [np.reshape(m.pixel, (1, 2)) for m in measured]
            numbers[photo_id] = np.concatenate(
                [block.ties.point[rays], np.array([number[m.point_id] for m in measured], int)]
            )
            pixels[photo_id] = np.concatenate([block.ties.pixels[rays], *places])
        first = block.ties.count + len(names)
        centres = {photo_id: first + i for i, photo_id in enumerate(block.photos)}
        return Sights(numbers, pixels, {i: name for name, i in number.items()}, centres)


@dataclass(frozen=True, slots=True, eq=False)
class StereoModel:
    """A pair in model space: the image space of its first photo, the base of unit length."""

    photo_ids: tuple[str, str]
    """The photos."""
    rotations: tuple[Rotation, Rotation]
    """Turn each image space into model space."""
    numbers: Indices
    """Points it holds, see `Sights`; the last two are the perspective centres."""
    positions: ObjectPoints
    """Their places."""
    sigma: ObjectPoints
    """Standard deviations for measurements good to a pixel."""

    def shared(self, numbers: Int[np.ndarray, "others"]) -> Flags:
        """Which of its points are among these."""
        return np.isin(self.numbers, numbers)


def form_models(block: Block, rng: np.random.Generator) -> tuple[StereoModel, ...]:
    """Every pair of a block that makes a model, by name."""
    sights = Sights.of(block)
    found = (form_model(block, sights, pair, rng) for pair in combinations(sorted(block.photos), 2))
    return tuple(model for model in found if isinstance(model, StereoModel))


def form_model(
    block: Block, sights: Sights, pair: tuple[str, str], rng: np.random.Generator
) -> StereoModel | Failure:
    """Relative orientation of two photos and the points where their rays meet."""
    first, second = pair
    numbers, ours, theirs = np.intersect1d(
        sights.numbers[first], sights.numbers[second], assume_unique=True, return_indices=True
    )
    if len(numbers) < LEAST_COMMON:
        return Failure(f"{first} and {second} have only {len(numbers)} points in common")
    photos = block.photos[first], block.photos[second]
    pixels = sights.pixels[first][ours], sights.pixels[second][theirs]
    curved = ray_pairs(photos, (block.camera_of(first), block.camera_of(second)), *pixels)
    rays = replace(
        curved,
        first=over_a_plane(curved.first, photos[0]),
        second=over_a_plane(curved.second, photos[1]),
    )
    width, height = (float(side) for side in photos[1].size_px)
    start = relative_from_exteriors(photos[0].exterior, photos[1].exterior)
    found = orient_relative(rays, (width, height), start, OPTIONS, rng)
    if isinstance(found, Failure):
        return found
    base, turn = found.orientation.base, found.orientation.rotation
    here, there = model_depths(rays, found.orientation)
    met = (here[:, None] * rays.first + base + there[:, None] * (rays.second @ turn.T)) / 2
    plan = np.abs(here) * rays.pixel_angles[0]
    sigma = np.column_stack([plan, plan, plan * np.abs(here) * np.sqrt(2)])[found.agrees]
    # The perspective centres of a model are as sure as its heights: they hang on the same angles.
    centre = np.full((2, 3), np.median(sigma[:, 2]))
    return StereoModel(
        pair,
        (np.eye(3), turn),
        np.append(numbers[found.agrees], [sights.centres[first], sights.centres[second]]),
        np.vstack([met[found.agrees], np.zeros(3), base]),
        np.vstack([sigma, centre]),
    )


def over_a_plane(rays: Rays, photo: Photo) -> Rays:
    """Rays as they would be if the ground of the map were a plane.

    Models are bodies in space, coordinates of a map are not: points far from the nadir lie lower.
    The photo's approximate orientation and height over ground are good enough to tell by how much.
    """
    above = float(photo.exterior.centre[2]) - photo.ground_height_m
    turned = rays @ photo.exterior.object_from_image.T
    slope = turned[:, :2] / -turned[:, 2:]
    plane = slope * above
    for _ in range(3):
        fall = photo.atmosphere.curvature_per_m * np.sum(plane**2, axis=1, keepdims=True)
        plane = slope * (above + fall)
    flat = np.column_stack([plane, np.full(len(plane), -above)]) @ photo.exterior.object_from_image
    return flat / -flat[:, 2:]
