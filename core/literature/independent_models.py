"""Aerial triangulation by independent models: pairs as rigid bodies, all fitted to control at once.

A model is two photos in correct relative orientation, with the points both show. Each is shifted,
rotated and scaled (seven unknowns) so that its points and its perspective centres fit those of its
neighbours and the control (Ackermann, Ebner, Klein 1970).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Int
from scipy import sparse
from scipy.sparse.linalg import splu

from core.arrays import Flags, Indices, ObjectPoints, PixelPoints, Position, Rotation
from core.block import Block, Photo
from core.doubts import Failure
from core.geometry.exterior import (
    UNKNOWNS,
    ExteriorOrientation,
    Similarity,
    SimilarityInSpace,
    angles_from_rotation,
    fit_similarity,
)
from core.geometry.relative import (
    Rays,
    RelativeOptions,
    model_depths,
    orient_relative,
    relative_from_exteriors,
)
from core.ties.matches import ray_pairs

# design: twice the six points of the textbook's model (von Gruber), so that a wrong one shows.
LEAST_COMMON = 12
"""Two photos with fewer common points are no model."""
# design: refined ties are good to a third of a pixel and control to one, so that four pixels keep
# all good points; ten agreeing points are twice the five that fix a pair.
OPTIONS = RelativeOptions(tolerance_px=4.0, min_inliers=10)
"""Points are measured by now, and their errors known: wrong ones stand far out."""
# design: an upper limit; STILL_M ends the adjustment.
PASSES = 8
# design: far below what any method reaches on the ground.
STILL_M = 1e-4
"""The adjustment ends when no model is shifted by more, metres."""
# design: a ten-thousandth of their weight; it fixes what would else be singular.
SOFT = 100.0
"""So much less than their priors say approximate perspective centres count."""
Placed = dict[int, Position]
"""Places of points by number."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Triangulated:
    """A block whose photos another method than the bundle has oriented."""

    block: Block
    """With the exterior orientations found."""
    joint_m: Position | None
    """RMS of what is left where models or strips meet: E, N, height, metres; None for bundles."""


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
    found = orient_relative(rays, (width, height), start, OPTIONS, rng=rng)
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


def triangulate_models(
    block: Block, models: Sequence[StereoModel], sights: Sights
) -> Triangulated | Failure:
    """Orient a block by independent models.

    Args:
        block: Photos, ties and measured control; without three control points that models show,
            the approximate perspective centres hold the block.
        models: Its models.
        sights: The count of their points.
    """
    bodies = join_models(models)
    if len({name for model in models for name in model.photo_ids}) < len(block.photos):
        return Failure("some photos make no model with any other")
    if bodies is None:
        return Failure("the models do not hang together")
    known = known_places(block, sights)
    whole = onto_ground(models, bodies, known, block, sights)
    bodies = [compose(whole, body) for body in bodies]
    holds = [*known.items(), *_soft_centres(block, sights)]
    residual = np.zeros((0, 3))
    for _ in range(PASSES):
        bodies, residual, moved = _adjusted(models, bodies, holds)
        if moved < STILL_M:
            break
    photos = {
        name: replace(block.photos[name], exterior=exterior, oriented=True)
        for name, exterior in _exteriors(models, bodies).items()
    }
    return Triangulated(block.with_photos(photos), np.sqrt(np.mean(residual**2, axis=0)))


Hold = tuple[int, tuple[Position, Position]]
"""Number of a point, its known place and standard deviations, metres."""


def known_places(block: Block, sights: Sights) -> dict[int, tuple[Position, Position]]:
    """Control points with their standard deviations."""
    return {
        number: (block.surveyed[name].position, block.surveyed[name].sigma_m)
        for number, name in sights.control.items()
    }


def _soft_centres(block: Block, sights: Sights) -> list[Hold]:
    """The approximate perspective centres: they decide what control leaves open, and no more."""
    return [
        (sights.centres[name], (photo.approximate.centre, SOFT * photo.prior.sigma_centre_m))
        for name, photo in block.photos.items()
    ]


def join_models(models: Sequence[StereoModel]) -> list[Similarity] | None:
    """Each model laid on those before it, the best connected first; None when that fails."""
    bodies: dict[int, Similarity] = {0: Similarity(1.0, np.eye(3), np.zeros(3))}
    placed: Placed = dict(zip(models[0].numbers.tolist(), models[0].positions, strict=True))
    while len(bodies) < len(models):
        have = np.array(list(placed))
        waiting = [i for i in range(len(models)) if i not in bodies]
        best = max(waiting, key=lambda i: int(models[i].shared(have).sum()))
        body = fit_model(models[best], placed)
        if body is None:
            return None
        bodies[best] = body
        moved = body.moved(models[best].positions)
        for number, place in zip(models[best].numbers.tolist(), moved, strict=True):
            placed.setdefault(number, place)
    return [bodies[i] for i in range(len(models))]


def fit_model(model: StereoModel, placed: Mapping[int, Position]) -> Similarity | None:
    """A model moved onto points that are placed; None with fewer than three."""
    common = model.shared(np.array(list(placed), int))
    if common.sum() < 3:
        return None
    target = np.array([placed[number] for number in model.numbers[common].tolist()])
    weights = 1 / np.sum(model.sigma[common] ** 2, axis=1)
    return fit_similarity(model.positions[common], target, weights)


def onto_ground(
    models: Sequence[StereoModel],
    bodies: Sequence[Similarity],
    known: Mapping[int, tuple[Position, Position]],
    block: Block,
    sights: Sights,
) -> Similarity:
    """The joined models as one body on control, or on the approximate centres."""
    places: Placed = {}
    for model, body in zip(models, bodies, strict=True):
        places |= dict(zip(model.numbers.tolist(), body.moved(model.positions), strict=True))
    targets = {number: place for number, (place, _) in known.items() if number in places}
    for name, photo in block.photos.items():
        if len(targets) < 3 or len(known) < 3:
            targets[sights.centres[name]] = photo.approximate.centre
    source = np.array([places[number] for number in targets])
    return fit_similarity(source, np.array(list(targets.values())), np.ones(len(targets)))


def compose(outer: Similarity, inner: Similarity) -> Similarity:
    """One similarity after another."""
    return Similarity(
        outer.scale * inner.scale,
        outer.rotation @ inner.rotation,
        outer.scale * outer.rotation @ inner.shift + outer.shift,
    )


def _adjusted(
    models: Sequence[StereoModel], bodies: Sequence[Similarity], holds: Sequence[Hold]
) -> tuple[list[Similarity], ObjectPoints, float]:
    """One step of least squares: the bodies, what is left at the joints, the largest shift."""
    numbers = np.unique(np.concatenate([model.numbers for model in models]))
    first = UNKNOWNS * len(models)
    rows: list[Any] = []
    targets: list[np.ndarray] = []
    weights: list[np.ndarray] = []
    abouts: list[Position] = []
    for i, (model, body) in enumerate(zip(models, bodies, strict=True)):
        moved = body.moved(model.positions)
        abouts.append(moved.mean(axis=0))
        own = _small_motions(moved - abouts[-1])
        point = first + 3 * np.searchsorted(numbers, model.numbers)
        rows.append(_rows(own, UNKNOWNS * i, point, first + 3 * len(numbers)))
        targets.append(-moved.ravel())
        weights.append(1 / (body.scale * model.sigma).ravel() ** 2)
    for number, (place, sigma) in holds:
        if number in numbers:
            column = first + 3 * int(np.searchsorted(numbers, number))
            rows.append(_rows(np.zeros((3, 0)), 0, np.array([column]), first + 3 * len(numbers)))
            targets.append(-place)
            weights.append(1 / sigma**2)
    design: Any = sparse.vstack(rows).tocsc()
    target, weight = np.concatenate(targets), np.concatenate(weights)
    normal = (design.T @ sparse.diags(weight) @ design).tocsc()
    solution = splu(normal).solve(design.T @ (weight * target))
    steps = solution[:first].reshape(-1, UNKNOWNS)
    left = (design @ solution - target)[: 3 * sum(len(model.numbers) for model in models)]
    turned = [
        compose(_as_similarity(SimilarityInSpace(about, step)), body)
        for about, step, body in zip(abouts, steps, bodies, strict=True)
    ]
    return turned, left.reshape(-1, 3), float(np.abs(steps[:, :3]).max())


def _small_motions(arms: ObjectPoints) -> np.ndarray:
    """Derivatives (3 n, 7) of points by a small shift, turn and change of scale."""
    x, y, z = arms.T
    nought, own = np.zeros_like(x), np.zeros((len(arms), 3, UNKNOWNS))
    own[:, :, :3] = np.eye(3)
    own[:, :, 3] = np.column_stack([nought, -z, y])
    own[:, :, 4] = np.column_stack([z, nought, -x])
    own[:, :, 5] = np.column_stack([-y, x, nought])
    own[:, :, 6] = arms
    return own.reshape(-1, UNKNOWNS)


def _rows(own: np.ndarray, column: int, point: Indices, width: int) -> Any:
    """Equations of points: what their model does to them less where they are."""
    count = 3 * len(point)
    columns = (point[:, None] + np.arange(3)).ravel()
    free = sparse.csr_matrix((-np.ones(count), (np.arange(count), columns)), shape=(count, width))
    if not own.shape[1]:
        return free
    spread = np.tile(column + np.arange(own.shape[1]), count)
    index = np.repeat(np.arange(count), own.shape[1])
    return free + sparse.csr_matrix((own.ravel(), (index, spread)), shape=(count, width))


def _as_similarity(small: SimilarityInSpace) -> Similarity:
    """A motion about a point as a motion of all space."""
    scale, turn = 1.0 + float(small.step[6]), small.rotation
    return Similarity(scale, turn, small.about + small.step[:3] - scale * turn @ small.about)


def _exteriors(
    models: Sequence[StereoModel], bodies: Sequence[Similarity]
) -> dict[str, ExteriorOrientation]:
    """Orientation of each photo: the mean of those its models give it."""
    centres: dict[str, list[Position]] = {}
    turns: dict[str, list[np.ndarray]] = {}
    for model, body in zip(models, bodies, strict=True):
        places = body.moved(model.positions[-2:])
        for name, place, turn in zip(model.photo_ids, places, model.rotations, strict=True):
            centres.setdefault(name, []).append(place)
            turns.setdefault(name, []).append(body.rotation @ turn)
    found: dict[str, ExteriorOrientation] = {}
    for name in sorted(centres):
        left, _, right = np.linalg.svd(np.sum(turns[name], axis=0))
        centre = np.mean(centres[name], axis=0)
        found[name] = ExteriorOrientation(centre, *angles_from_rotation(left @ right))
    return found
