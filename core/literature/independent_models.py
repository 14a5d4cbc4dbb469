"""Aerial triangulation by independent models: pairs as bodies, all laid on control at once.

Each model is shifted, turned and scaled (seven unknowns) so that its points, and its perspective
centres, meet those of its neighbours and the control (Ackermann, Ebner, Klein 1970).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from core.arrays import Indices, ObjectPoints, Position
from core.block import Block
from core.doubts import Failure
from core.geometry.exterior import (
    UNKNOWNS,
    ExteriorOrientation,
    Similarity,
    SimilarityInSpace,
    angles_from_rotation,
    fit_similarity,
)
from core.literature.stereo_models import Sights, StereoModel

PASSES = 8
STILL_M = 1e-4
"""The adjustment ends when no model is shifted by more, metres."""
SOFT = 100.0
"""So much less than their priors say approximate perspective centres count."""
Placed = dict[int, Position]
"""Places of points by number."""


@dataclass(frozen=True, slots=True, eq=False)
class Triangulated:
    """A block whose photos another method than the bundle has oriented."""

    block: Block
    """With the exterior orientations found."""
    joint_m: Position | None
    """RMS of what is left where models or strips meet: E, N, height, metres; None for bundles."""


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
    bodies = joined(models)
    if len({name for model in models for name in model.photo_ids}) < len(block.photos):
        return Failure("some photos make no model with any other")
    if bodies is None:
        return Failure("the models do not hang together")
    known = known_places(block, sights)
    whole = onto_ground(models, bodies, known, block, sights)
    bodies = [composed(whole, body) for body in bodies]
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


def joined(models: Sequence[StereoModel]) -> list[Similarity] | None:
    """Each model laid on those before it, the best connected first; None when that fails."""
    bodies: dict[int, Similarity] = {0: Similarity(1.0, np.eye(3), np.zeros(3))}
    placed: Placed = dict(zip(models[0].numbers.tolist(), models[0].positions, strict=True))
    while len(bodies) < len(models):
        have = np.array(list(placed))
        waiting = [i for i in range(len(models)) if i not in bodies]
        best = max(waiting, key=lambda i: int(models[i].shared(have).sum()))
        body = laid_upon(models[best], placed)
        if body is None:
            return None
        bodies[best] = body
        moved = body.moved(models[best].positions)
        for number, place in zip(models[best].numbers.tolist(), moved, strict=True):
            placed.setdefault(number, place)
    return [bodies[i] for i in range(len(models))]


def laid_upon(model: StereoModel, placed: Mapping[int, Position]) -> Similarity | None:
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


def composed(outer: Similarity, inner: Similarity) -> Similarity:
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
        composed(_as_similarity(SimilarityInSpace(about, step)), body)
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
