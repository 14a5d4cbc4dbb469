"""Datum: the tied block is laid on the reference by a vote of all photos.

A single photo over woods may agree with itself in the wrong place, because crowns and shadows move
together. Ties make one rigid body of all photos; only seven unknowns are left, and every reference
point in every photo contributes to them.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from core.arrays import Position
from core.block import Block, Photo
from core.doubts import Failure
from core.geometry.consensus import Candidates, Consensus, ConsensusOptions
from core.geometry.exterior import UNKNOWNS, SimilarityInSpace
from core.geometry.resection import PhotoModel
from core.localisation.photo_orientation import (
    OrientationOptions,
    finest_gsd_m,
    finest_reduction,
    ground_sigma_px,
)
from core.matching.local_search import (
    MATCH_FLOOR_PX,
    Found,
    MatchingOptions,
    candidates_of,
    match_points,
    predict_pixels,
)
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference
from core.raster.scan_file import ScanFile
from core.reference.stage import ReferencePoints

# design: crowns and shadows move what single photos agree on by about as much, all alike.
SHIFT_M = 8.0
"""Standard deviation of the block's place, and of its turn and scale at its edge, metres."""
# design: a sample of three in a thousand candidates of which one in ten is right is seen six times.
VOTE = ConsensusOptions(hypotheses=6000, gate=2.5)
"""The vote."""
# design: peaks are four pixels apart at least.
LEAST_SHIFT_PX = 4.0
"""The block's place is never taken to be surer than this many of the finest pixels: a search
window without room has no place for chance to show itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Ballot:
    """The candidates of one photo with what the block's seven unknowns do to them."""

    candidates: Candidates
    offset: np.ndarray
    design: np.ndarray


def lay_on_reference(
    block: Block,
    scans: Mapping[str, ScanFile],
    reference: Reference,
    points: ReferencePoints,
    orientation: OrientationOptions,
    rng: np.random.Generator,
    mapper: Callable[..., Iterable[Any]] = map,
) -> Block | Failure:
    """Shift, turn and scale all oriented photos as one body to where most candidates agree.

    Args:
        block: Oriented photos, in each other's right place.
        scans: Scans by photo.
        reference: Ortho and heights.
        points: Junctions and salient points.
        orientation: Sizes of the templates.
        rng: Source of the samples.
        mapper: Runs a function over photos.
    """
    photos = [photo for photo in block.photos.values() if photo.oriented]
    about = np.mean([photo.exterior.centre for photo in photos], axis=0)
    opened = [OpenPhoto(one, block.cameras[one.camera], scans[one.photo_id]) for one in photos]
    coarsest_m = max(finest_gsd_m(one, reference, orientation) for one in opened)
    shift_m = max(SHIFT_M, LEAST_SHIFT_PX * coarsest_m)

    def cast(photo: OpenPhoto) -> Ballot | None:
        return ballot(photo, reference, points, orientation, shift_m, about)

    ballots = [found for found in mapper(cast, opened) if found is not None]
    if not ballots:
        return Failure("no reference point could be searched in any photo")
    consensus = join_ballots(ballots, prior(block, photos, shift_m))
    steps = consensus.hypotheses(rng)
    _, step, chosen = min((consensus.refined(step) for step in steps), key=lambda found: found[0])
    residual = consensus.offset - consensus.design @ step
    e_value = consensus.log10_e_value(residual, consensus.design, step)
    evidence = {
        "searched": len(consensus.first), "agreeing": len(chosen), "log10_e_value": e_value,
    }  # fmt: skip
    if e_value < VOTE.least_log10_e_value:
        return Failure("the block's agreement with the reference could be chance", evidence)
    similarity = SimilarityInSpace(about, step)
    return block.with_photos(
        {
            name: photo.with_exterior(similarity.moved(photo.exterior), True)
            if photo.oriented
            else photo
            for name, photo in block.photos.items()
        }
    )


def prior(block: Block, photos: list[Photo], shift_m: float) -> np.ndarray:
    """Covariance of the seven unknowns: the block's edge may move as far as its middle."""
    centres = np.array([photo.exterior.centre for photo in photos])
    above = float(np.mean([photo.exterior.centre[2] - photo.ground_height_m for photo in photos]))
    spread = np.hypot(*(centres - centres.mean(axis=0))[:, :2].T).max()
    radius = max(float(spread), above / 2)
    turn = shift_m / radius
    return np.diag(np.array([shift_m] * 3 + [turn] * 4) ** 2)


def ballot(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    orientation: OrientationOptions,
    shift_m: float,
    about: Position,
) -> Ballot | None:
    """Candidates of one photo within two standard deviations of the block's place."""
    reduction = finest_reduction(opened, reference, orientation)
    half = int(np.ceil(2 * shift_m / opened.ground_pixel_m / reduction))
    matching = MatchingOptions(
        reduction=reduction,
        template_half_px=orientation.template_half_px,
        operators=orientation.operators,
        min_search_px=half,
        max_search_px=half,
    )
    prediction = predict_pixels(opened, np.zeros((6, 6)), points.positions, points.sigma_m)
    found: list[Found] = match_points(opened, reference, prediction, matching)
    if not found:
        return None
    sigma = ground_sigma_px(opened, points.sigma_m)
    candidates = candidates_of(found, sigma, floor_px=MATCH_FLOOR_PX * reduction)
    model = PhotoModel(opened.photo.interior, opened.camera, opened.photo.atmosphere)
    derivatives = np.empty((len(points.ids), 2, UNKNOWNS))
    exterior = opened.photo.exterior
    above = float(exterior.centre[2]) - opened.photo.ground_height_m
    # design: a step of ten centimetres at the photo, small against the curvature of projection.
    for unknown, size in enumerate([0.1] * 3 + [0.1 / above] * 4):
        step = np.zeros(UNKNOWNS)
        step[unknown] = size
        ahead = model.pixels(points.positions, SimilarityInSpace(about, step).moved(exterior))
        behind = model.pixels(points.positions, SimilarityInSpace(about, -step).moved(exterior))
        derivatives[:, :, unknown] = (ahead - behind) / (2 * size)
    offset = candidates.pixels - prediction.pixels[candidates.point]
    return Ballot(candidates, offset, derivatives[candidates.point])


def join_ballots(ballots: list[Ballot], prior_covariance: np.ndarray) -> Consensus:
    """All ballots as one vote; a point in two photos has two voices."""
    first = np.cumsum([0, *(int(one.candidates.point.max()) + 1 for one in ballots[:-1])])

    def every(name: str) -> np.ndarray:
        return np.concatenate([getattr(one.candidates, name) for one in ballots])

    point = np.concatenate(
        [one.candidates.point + start for one, start in zip(ballots, first, strict=True)]
    )
    candidates = Candidates(
        point, every("pixels"), every("sigma_px"), every("weight"), every("trust"), every("chance")
    )
    offset = np.concatenate([one.offset for one in ballots])
    design = np.concatenate([one.design for one in ballots])
    return Consensus(candidates, offset, design, prior_covariance, options=VOTE)
