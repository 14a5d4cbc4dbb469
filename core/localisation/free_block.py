"""The free block: relative positions of all photos from tie points alone.

Every photo is a plane similarity over level ground (independent models in plan), which is linear
and needs no approximations. The bundle adjustment after it gives the third dimension. Only then is
the whole placed on the reference, as one body.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.arrays import PlanPosition, Scalars
from core.block import Block, ExteriorPrior, Photo
from core.geometry.exterior import ExteriorOrientation
from core.geometry.robust import cauchy_weights, solve_robustly
from core.ties.chains import with_rays

# design: twice what a similarity needs to be checked by each of its points.
MIN_COMMON = 8
"""Photos with fewer common tie points do not hold each other."""
# design: time; only a start for the bundle adjustment.
PASSES = 6
"""Solutions of the plane block, each with the weights of the one before."""
FAR = 3.0  # design: beyond 3 sigma a good ray is one in a hundred.
"""At this many robust standard deviations a ray has half its weight."""
# source: normal distribution; one in eighty lies further off.
SEARCH_SIGMAS = 2.5
"""A turn is possible when the sources are off by no more than this on the average."""
# design: a third of what the surest source is sure of.
TURN_STEP = float(np.radians(1.0))
"""Turns of the whole block are weighed in such steps."""
Similarities = Float64[np.ndarray, "photos 4"]
"""a, b, E, N of each photo: E = a x - b y + E0, N = b x + a y + N0, from film mm to metres."""


@dataclass(frozen=True, slots=True, eq=False)
class FreeBlock:
    """Photos that tie points join, in each other's right place; the block may lie anywhere."""

    block: Block
    """These photos alone, with their ties."""
    turns: Scalars
    """Turns about the middle (radians) under which their sources agree best, likeliest first."""
    turn_sigmas: Scalars
    """By turn, how far it puts the sources off on the average, standard deviations."""
    tied: bool
    """Whether ties brought them together; False for one photo by itself."""


def free_blocks(
    block: Block,
    hypotheses: Mapping[str, Sequence[ExteriorOrientation]],
    options: AdjustmentOptions,
) -> tuple[FreeBlock, ...]:
    """Every connected part of a block, adjusted by its ties, the largest first.

    Args:
        block: Photos with approximate orientations and priors, and the tie points.
        hypotheses: By photo, all orientations its source leaves open.
        options: The adjustment.
    """
    return tuple(
        _free_block(part(block, names), hypotheses, options) for names in connected_photos(block)
    )


def connected_photos(block: Block) -> list[tuple[str, ...]]:
    """Names of the photos of each part that enough common tie points join, largest part first."""
    names = sorted(block.photos)
    ties = block.ties
    seen = sparse.csr_matrix(
        (np.ones(len(ties.point)), (ties.photo, ties.point)),
        shape=(len(ties.photo_ids), max(ties.count, 1)),
    )
    common: Any = (seen @ seen.T).toarray() >= MIN_COMMON
    joined = np.zeros((len(names), len(names)), bool)
    rows = np.array([names.index(name) for name in ties.photo_ids if name in block.photos], int)
    own = np.array([name in block.photos for name in ties.photo_ids], bool)
    joined[np.ix_(rows, rows)] = common[np.ix_(own, own)]
    count, label = connected_components(sparse.csr_matrix(joined), directed=False)
    parts = [
        tuple(name for name, of in zip(names, label, strict=True) if of == i) for i in range(count)
    ]
    return sorted(parts, key=lambda names: (-len(names), names))


def part(block: Block, names: Sequence[str]) -> Block:
    """Some photos of a block with the ties between them."""
    keep = np.isin(np.array(block.ties.photo_ids, dtype=str), np.array(names, dtype=str))
    ties = block.ties
    if len(ties.point):
        ours = keep[ties.photo]
        rays = np.bincount(ties.point[ours], minlength=ties.count)
        ties = with_rays(ties, ours & (rays[ties.point] >= 2))
    photos = {name: block.photos[name] for name in names}
    return replace(block, photos=photos, ties=ties, measurements={}, surveyed={})


def _free_block(
    block: Block,
    hypotheses: Mapping[str, Sequence[ExteriorOrientation]],
    options: AdjustmentOptions,
) -> FreeBlock:
    """One connected part brought together."""
    names = list(block.photos)
    if len(names) == 1:
        kappas = [known.kappa for known in hypotheses[names[0]]]
        turns = np.array(kappas) - block.photos[names[0]].exterior.kappa
        return FreeBlock(block, turns, np.zeros(len(turns)), False)
    plane = plane_block(block)
    sources = [_Source.of(block.photos[name], hypotheses[name]) for name in names]
    turns, sigmas = likely_turns(plane, sources)
    placed, _ = laid_by_sources(plane, sources, float(turns[0]))
    standing = block.with_photos(
        {
            name: _stood_up(block, name, values, source)
            for name, values, source in zip(names, placed, sources, strict=True)
        }
    )
    report = adjust_block(standing, replace(options, robust=False, estimate_cameras=False))
    if report.converged:
        standing = standing.with_photos(
            {
                name: photo.with_exterior(report.block.photos[name].exterior, False)
                for name, photo in standing.photos.items()
            }
        )
    return FreeBlock(standing, np.asarray(turns - turns[0]), sigmas, True)


def plane_block(block: Block) -> Similarities:
    """Similarities of all photos of a connected block to one plane, by their ties alone.

    The first photo lies under its own film, at its approximate scale; each tie point is the
    weighted mean of its rays, which eliminates it. Rays that lie far off lose weight.
    """
    names = list(block.photos)
    design, target = _plane_rays(block, names)
    count = len(target)
    point = np.repeat(block.ties.point, 2) * 2 + np.tile([0, 1], len(block.ties.point))
    of_point = sparse.csr_matrix((np.ones(count), (np.arange(count), point)))

    def solve(weights: Scalars) -> tuple[np.ndarray, Scalars]:
        weight = np.repeat(weights, 2)
        weighted = of_point.T @ sparse.diags(weight)
        means = sparse.diags(1 / np.asarray(weighted.sum(axis=1)).ravel()) @ weighted
        reduced: Any = design - of_point @ (means @ design)
        offset = target - of_point @ (means @ target)
        normal = (reduced.T @ sparse.diags(weight) @ reduced).tocsc()
        solution = splu(normal).solve(-(reduced.T @ (weight * offset)))
        return solution, np.hypot(*np.reshape(reduced @ solution + offset, (-1, 2)).T)

    weigh = partial(cauchy_weights, limit=FAR)
    solution = solve_robustly(solve, np.ones(count // 2), weigh, passes=PASSES)
    first = np.array([_metres_per_mm(block, names[0]), 0.0, 0.0, 0.0])
    return np.vstack([first, solution.reshape(-1, 4)])


def _plane_rays(block: Block, names: list[str]) -> tuple[Any, Scalars]:
    """East and north of every ray in the plane: a matrix on the unknowns, and a known part."""
    ties = block.ties
    number = np.array(
        [names.index(name) if name in block.photos else -1 for name in ties.photo_ids]
    )
    owner = number[ties.photo]
    film = np.empty((len(owner), 2))
    for i, name in enumerate(names):
        rays = owner == i
        interior, camera = block.photos[name].interior, block.camera_of(name)
        film[rays] = interior.film_from_pixel(ties.pixels[rays]) - camera.principal_point_mm
    x, y = film.T
    east, north = 2 * np.arange(len(owner)), 2 * np.arange(len(owner)) + 1
    one = np.ones(len(owner))
    rows = np.concatenate([east, east, east, north, north, north])
    columns = np.concatenate([4 * owner + i for i in (0, 1, 2, 1, 0, 3)])
    values = np.concatenate([x, -y, one, x, y, one])
    shape = (2 * len(owner), 4 * len(names))
    matrix = sparse.csr_matrix((values, (rows, columns)), shape=shape)
    first = np.array([_metres_per_mm(block, names[0]), 0.0, 0.0, 0.0])
    return matrix[:, 4:], np.asarray(matrix[:, :4] @ first)


def _metres_per_mm(block: Block, name: str) -> float:
    """Ground metres to a millimetre of film, by the approximate orientation."""
    photo = block.photos[name]
    above = float(photo.approximate.centre[2]) - photo.ground_height_m
    return above / block.camera_of(name).principal_distance_mm


@dataclass(frozen=True, slots=True, eq=False)
class _Source:
    """What a photo's source says of it."""

    hypotheses: Sequence[ExteriorOrientation]
    prior: ExteriorPrior
    sigma_m: float
    sigma_scale: float

    @staticmethod
    def of(photo: Photo, hypotheses: Sequence[ExteriorOrientation]) -> "_Source":
        above = float(photo.approximate.centre[2]) - photo.ground_height_m
        tilt = above * float(np.max(photo.prior.sigma_angles[:2]))
        plan = float(np.hypot(np.max(photo.prior.sigma_centre_m[:2]), tilt))
        return _Source(hypotheses, photo.prior, plan, float(photo.prior.sigma_centre_m[2]) / above)

    @property
    def centre(self) -> PlanPosition:
        """Easting, northing of the perspective centre, metres."""
        return self.hypotheses[0].centre[:2]

    def nearest(self, kappa: float) -> tuple[float, ExteriorOrientation]:
        """The hypothesis of the nearest kappa, and how far off that is, standard deviations."""
        away = [float(np.angle(np.exp(1j * (h.kappa - kappa)))) for h in self.hypotheses]
        best = int(np.argmin(np.abs(away)))
        return abs(away[best]) / float(self.prior.sigma_angles[2]), self.hypotheses[best]


def laid_by_sources(
    plane: Similarities, sources: Sequence[_Source], turn: float
) -> tuple[Similarities, float]:
    """The plane block turned, then scaled and shifted as its sources want it, and what it costs.

    The cost is the sum of squared differences in standard deviations. Sources that all name one
    place say where the block lies, and nothing of how its photos lie to each other.
    """
    about = np.exp(1j * turn)
    linear = (plane[:, 0] + 1j * plane[:, 1]) * about
    place = (plane[:, 2] + 1j * plane[:, 3]) * about
    known = np.array([source.centre[0] + 1j * source.centre[1] for source in sources])
    weight = np.array([1 / source.sigma_m**2 for source in sources])
    scale_weight = sum(1 / source.sigma_scale**2 for source in sources) / len(sources)
    middle = np.sum(weight * place) / weight.sum(), np.sum(weight * known) / weight.sum()
    own, theirs = place - middle[0], known - middle[1]
    if not np.any(np.abs(known - known[0]) > 0):
        weight = np.zeros_like(weight)
    top = float(np.sum(weight * (own * theirs.conj()).real)) + scale_weight
    scale = max(top / (float(np.sum(weight * np.abs(own) ** 2)) + scale_weight), 0.5)
    kappas = np.angle(linear)
    turned = sum(
        source.nearest(float(kappa))[0] ** 2 for source, kappa in zip(sources, kappas, strict=True)
    )
    apart = float(np.sum(weight * np.abs(scale * own - theirs) ** 2))
    linear, place = scale * linear, scale * own + middle[1]
    placed = np.column_stack([linear.real, linear.imag, place.real, place.imag])
    return placed, apart + turned + scale_weight * (scale - 1) ** 2


def likely_turns(plane: Similarities, sources: Sequence[_Source]) -> tuple[Scalars, Scalars]:
    """Turns of the whole block that its sources leave possible, likeliest first, radians.

    Sources of one archive may all err the same way, so that many are no surer than one; and where
    they contradict each other by more than they admit, they leave more open.

    Returns:
        The turns, and how far each puts the sources off on the average, standard deviations.
    """
    turns = np.arange(-np.pi, np.pi, TURN_STEP)
    costs = np.array([laid_by_sources(plane, sources, float(turn))[1] for turn in turns])
    freedom = max(3 * len(sources) - 4, 1)
    usual = len(sources) * max(1.0, float(costs.min()) / freedom)
    sigmas = np.sqrt((costs - costs.min()) / usual)
    order = np.argsort(costs, kind="stable")
    likely = order[sigmas[order] <= SEARCH_SIGMAS]
    return turns[likely], sigmas[likely]


def _stood_up(block: Block, name: str, values: np.ndarray, source: _Source) -> Photo:
    """A photo as a vertical one where the plane block has it; its prior is the nearest source's."""
    photo, camera = block.photos[name], block.camera_of(name)
    metres_per_mm, kappa = float(np.hypot(*values[:2])), float(np.arctan2(values[1], values[0]))
    height = photo.ground_height_m + metres_per_mm * camera.principal_distance_mm
    centre = np.array([values[2], values[3], height])
    approximate = source.nearest(kappa)[1]
    return replace(
        photo, exterior=ExteriorOrientation(centre, 0.0, 0.0, kappa), approximate=approximate
    )
