"""Two published chains as presets, to be compared with: that of the thesis and Höhle-Potůčková.

Both correlate grey values of a junction's patch about where the georeference puts it. The thesis
takes the five best pixels above a threshold, joins neighbours, and keeps what RANSAC with a DLT
agrees on; Höhle and Potůčková take the best pixel above a high threshold. What they keep enters the
same bundle adjustment as everything else. Two things are kinder here than in the originals: the
ortho is warped into the scan with the DEM, and heights are of the bare earth.

The DLT (direct linear transformation) has eleven parameters, which nearly level ground does not
determine (thesis: Milovice); `is_flat` tells so. With the principal distance known,
`core/geometry/resection.py` needs three points where this needs six.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from jaxtyping import Float64, Int

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.arrays import Indices, ObjectPoints, PixelPoints, Scalars
from core.block import Block, Measurement, Peak, Photo
from core.control.proposals import surveyed_of, with_proposals
from core.doubts import Doubt
from core.literature.baselines import NccOperator
from core.localisation.initial_orientation import Site
from core.matching.local_search import (
    MatchingOptions,
    looked_at,
    predict_pixels,
    reduction_for,
)
from core.matching.patches import OpenPhoto
from core.matching.peaks import ScoreMap
from core.reference.stage import ReferencePoints

Preset = Literal["gruber", "thesis-2024", "thesis-2024-1980s", "hoehle-2001"]
"""Our own way, and the chains to compare it with."""
NCC = NccOperator()
NAMED = {"junction"}
"""Both chains know nothing but junctions."""
Transform = Literal["dlt", "projective"]
"""Direct linear transformation of points in space, or projective one of their places in plan."""
# source: definitions of the two (thesis, chapters 3.7 and 3.8).
AXES: dict[Transform, int] = {"dlt": 3, "projective": 2}
"""Coordinates of the ground that a transformation takes."""
# source: six points give twelve equations for eleven parameters, four eight for eight.
SAMPLES_OF: dict[Transform, int] = {"dlt": 6, "projective": 4}
"""Points that determine a transformation."""
# design: memory; two megabytes for every hundred candidates.
BATCH = 2000
# design: the thesis could not use a DLT at Milovice, with 20 m of relief at most.
LEAST_RELIEF = 0.02
"""Below this share of the flying height the relief does not determine the parameters."""
Agreeing = Int[np.ndarray, "agreeing"]
"""Indices of candidates."""
Models = Float64[np.ndarray, "samples parameters"]
"""Parameters of many transformations, eleven of a DLT, eight of a projective one."""


@dataclass(frozen=True, slots=True)
class RansacOptions:
    """The plain RANSAC of the thesis (script 7)."""

    # source: thesis, Table 6.
    samples: int = 100_000
    """Samples of as many points as the transformation needs."""
    # source: thesis, Table 6: 4 m at 1 m a pixel.
    threshold_px: float = 4.0
    """A point agrees when the model puts it closer than this, pixels."""
    transform: Transform = "dlt"
    """What a sample determines."""


@dataclass(frozen=True, slots=True)
class PublishedOptions:
    """The parameters of one chain (thesis, Table 6; chapter 2.3)."""

    # source: thesis, Table 6.
    gsd_m: float = 1.0
    """Ground sample distance of scan and ortho, metres."""
    # source: thesis, Table 6.
    template: float = 51.0
    """Side of the patch, metres; pixels where `in_pixels`."""
    # source: thesis, Table 6, photos of 1938.
    window: float = 110.0
    """Side of the searched area, template included, metres or pixels."""
    in_pixels: bool = False
    """Whether template and window are given in pixels."""
    # source: thesis, Table 6.
    best: int = 5
    """So many of the best pixels are candidates; neighbours are joined."""
    # source: thesis, Table 6, photos of 1938.
    least_ncc: float = 0.4
    """Correlation a pixel has at least."""
    # source: thesis, Table 6.
    border_m: float = 5.0
    """Nothing is taken closer to the border of the picture, metres."""
    # source: thesis, Table 6, photos of 1938.
    ransac_m: float | None = 4.0
    """Threshold of RANSAC with the DLT, metres; None leaves it to the adjustment."""
    # source: thesis, Table 6.
    samples: int = 100_000
    """Samples of RANSAC."""
    transform: Transform = "dlt"
    """What RANSAC fits."""
    # source: thesis: Campari with GCP=[3 m, 5.22 px].
    sigma_m: float = 3.0
    """Standard deviation of control per axis in the adjustment, metres."""
    # source: the same.
    sigma_px: float = 5.22
    """Standard deviation of its measurement, pixels."""

    @property
    def ransac(self) -> RansacOptions:
        """RANSAC on a grid of this resolution."""
        return RansacOptions(self.samples, (self.ransac_m or 0.0) / self.gsd_m, self.transform)


MILOVICE_1938 = PublishedOptions()
# source: thesis, Table 6; level ground, so that no DLT could be had.
MILOVICE_1989 = PublishedOptions(window=440.0, least_ncc=0.45, ransac_m=3.0, transform="projective")
# source: thesis, Table 6.
KOBYLI_1938 = PublishedOptions(window=90.0, ransac_m=2.0)
# source: thesis, Table 6, photos of 1984.
KOBYLI_1984 = PublishedOptions(window=160.0, least_ncc=0.45, ransac_m=2.0)
# source: thesis, chapter 2.3, on Höhle and Potůčková 2001: sizes and limit. design: it gives no
# standard deviations; a metre and a pixel are usual.
HOEHLE_2001 = PublishedOptions(
    template=31.0, window=61.0, in_pixels=True, best=1, least_ncc=0.7, ransac_m=None,
    sigma_m=1.0, sigma_px=1.0,
)  # fmt: skip
CHAINS: dict[Preset, PublishedOptions] = {
    "thesis-2024": MILOVICE_1938,
    "thesis-2024-1980s": KOBYLI_1984,
    "hoehle-2001": HOEHLE_2001,
}
"""Every chain by its name; the thesis had other limits for its photos of the 1980s."""


def assemble_published(
    block: Block,
    site: Site,
    options: PublishedOptions,
    adjustment: AdjustmentOptions,
    rng: np.random.Generator,
    mapper: Callable[..., Iterable[Any]] = map,
) -> tuple[AdjustmentReport, tuple[Doubt, ...]]:
    """Control by one of the chains, and the adjustment with it.

    Args:
        block: Photos with approximate orientations, and the tie points.
        site: Reference, scans and reference points.
        options: The chain.
        adjustment: The adjustment.
        rng: Source of the samples.
        mapper: Runs a function over photos.
    """
    rows = [i for i, name in enumerate(site.points.ids) if site.sources[name] in NAMED]
    points = ReferencePoints(
        tuple(site.points.ids[i] for i in rows),
        site.points.positions[rows],
        np.full((len(rows), 3), options.sigma_m),
    )
    photos = list(block.photos.values())
    seeds = rng.integers(0, 2**63, len(photos))

    def searched(job: tuple[Photo, int]) -> tuple[Measurement, ...]:
        photo, seed = job
        opened = OpenPhoto(photo, block.cameras[photo.camera], site.scans[photo.photo_id])
        return kept_of(opened, site, points, options, np.random.default_rng(seed))

    jobs = list(zip(photos, seeds.tolist(), strict=True))
    measured = tuple(value for values in mapper(searched, jobs) for value in values)
    seen = {value.photo_id for value in measured}
    standing = block.with_photos(
        {
            name: photo.with_exterior(photo.exterior, name in seen)
            for name, photo in block.photos.items()
        }
    )
    report = adjust_block(
        with_proposals(standing, surveyed_of(points, site.sources), measured), adjustment
    )
    return report, flatness(block, points, options)


def flatness(block: Block, points: ReferencePoints, options: PublishedOptions) -> tuple[Doubt, ...]:
    """The warning that the ground is too level for a DLT."""
    first = next(iter(block.photos.values()))
    above = float(first.exterior.centre[2]) - first.ground_height_m
    if options.ransac_m is None or not is_flat(points.positions[:, 2], above):
        return ()
    relief = float(np.ptp(points.positions[:, 2])) if len(points.ids) else 0.0
    message = (
        f"The relief of {relief:.0f} m is too low for the eleven parameters of a DLT; "
        "what it agrees on may be chance."
    )
    return (Doubt("control-flat", "block", message, evidence={"relief_m": relief}),)


def kept_of(
    opened: OpenPhoto,
    site: Site,
    points: ReferencePoints,
    options: PublishedOptions,
    rng: np.random.Generator,
) -> tuple[Measurement, ...]:
    """What one chain keeps of one photo."""
    reduction = reduction_for(opened, options.gsd_m)
    pixel_m = opened.ground_pixel_m * reduction
    unit = 1.0 if options.in_pixels else 1.0 / pixel_m
    inner = round((options.template * unit - 1) / 2)
    half = round((options.window - options.template) * unit / 2)
    matching = MatchingOptions(
        reduction=reduction,
        template_half_px=inner,
        min_search_px=half,
        max_search_px=half,
        operators=(NCC,),
    )
    prediction = predict_pixels(opened, np.zeros((6, 6)), points.positions, points.sigma_m)
    halves = np.full(len(points.ids), half)
    found: list[tuple[int, Peak]] = []
    for view, point in looked_at(opened, site.reference, prediction, halves, matching):
        for column, row, score in joined_pixels(view.scores(NCC.name), options):
            place = view.centre[0] + (np.array([column, row]) - half) * reduction
            if away_from_border(opened, place, options.border_m):
                column, row = (float(value) for value in place)
                found.append((point, Peak(column, row, options.sigma_px, score, NCC.name)))
    kept = agreed(opened, points, found, options, rng)
    best: dict[int, Peak] = {}
    for index in kept.tolist():
        point, peak = found[index]
        if point not in best or peak.score > best[point].score:
            best[point] = peak
    name = opened.photo.photo_id
    return tuple(
        Measurement(points.ids[point], name, peak.column, peak.row, options.sigma_px, peak.score)
        for point, peak in sorted(best.items())
    )


def joined_pixels(scores: ScoreMap, options: PublishedOptions) -> list[tuple[float, float, float]]:
    """The best pixels, neighbours joined to their mean weighted by correlation (script 6)."""
    order = np.argsort(-scores, axis=None, kind="stable")[: options.best]
    chosen = np.zeros(scores.shape, np.uint8)
    rows, columns = np.unravel_index(order, scores.shape)
    high = scores[rows, columns] >= options.least_ncc
    chosen[rows[high], columns[high]] = 1
    # source: thesis, Table 6: clusters in the neighbourhood of eight.
    count, labels = cv2.connectedComponents(chosen, connectivity=8)
    clusters: list[tuple[float, float, float]] = []
    for label in range(1, count):
        down, across = np.nonzero(labels == label)
        weight = scores[down, across].astype(np.float64)
        total = float(weight.sum())
        clusters.append(
            (float(weight @ across) / total, float(weight @ down) / total, float(weight.mean()))
        )
    return clusters


def away_from_border(opened: OpenPhoto, place: np.ndarray, border_m: float) -> bool:
    """Whether a place lies within the picture, far enough from its border."""
    film = opened.photo.interior.film_from_pixel(place[None])[0]
    margin = border_m / opened.ground_pixel_m * opened.photo.interior.pixel_size_mm
    return bool(np.all(np.abs(film) < np.array(opened.camera.frame_mm) / 2 - margin))


def agreed(
    opened: OpenPhoto,
    points: ReferencePoints,
    found: list[tuple[int, Peak]],
    options: PublishedOptions,
    rng: np.random.Generator,
) -> Indices:
    """Candidates that RANSAC keeps; all of them without it."""
    if options.ransac_m is None:
        return np.arange(len(found))
    owner = np.array([point for point, _ in found], dtype=np.int64)
    pixels = np.array([[peak.column, peak.row] for _, peak in found]).reshape(-1, 2)
    limit = options.ransac_m / opened.ground_pixel_m
    ransac = RansacOptions(options.samples, limit, options.transform)
    return agreeing_points(points.positions[owner], pixels, owner, ransac, rng)


def agreeing_points(
    points: ObjectPoints,
    pixels: PixelPoints,
    owner: Indices,
    options: RansacOptions,
    rng: np.random.Generator,
) -> Agreeing:
    """Candidates that the best of many samples agrees with.

    As in the thesis: most candidates win, ties go to the lesser sum of distances, the sample itself
    counts, nothing is refitted.

    Args:
        points: Known point of each candidate, metres.
        pixels: Where each candidate lies.
        owner: Number of the known point of each candidate; a sample has different ones.
        options: How many, how near.
        rng: Source of the samples.
    """
    least_points = SAMPLES_OF[options.transform]
    if len(np.unique(owner)) < least_points:
        return np.zeros(0, dtype=np.int64)
    ground = conditioned(points[:, : AXES[options.transform]])
    image = conditioned(pixels)
    best, least = np.zeros(0, dtype=np.int64), (0, 0.0)
    scale = float(np.std(pixels - pixels.mean(axis=0)))
    for start in range(0, options.samples, BATCH):
        size = min(BATCH, options.samples - start)
        drawn = np.argsort(rng.random((size, len(points))), axis=1)[:, :least_points]
        named = np.sort(owner[drawn], axis=1)
        drawn = drawn[(np.diff(named, axis=1) > 0).all(axis=1)]
        models = solved(ground[drawn], image[drawn])
        away = distances(models, ground, image) * scale
        near = away < options.threshold_px
        count, total = near.sum(axis=1), np.where(near, away, 0.0).sum(axis=1)
        order = np.lexsort((total, -count))
        if len(order):
            first = int(order[0])
            found = (-int(count[first]), float(total[first]))
            if found < least:
                least, best = found, np.flatnonzero(near[first])
    return best


def conditioned(points: Float64[np.ndarray, "n axes"]) -> Float64[np.ndarray, "n axes"]:
    """Coordinates about their mean in units of their common spread."""
    centred = points - points.mean(axis=0)
    # design: keeps the division finite where all points are one.
    return centred / max(float(np.std(centred)), 1e-12)


def solved(
    ground: Float64[np.ndarray, "samples points axes"],
    image: Float64[np.ndarray, "samples points 2"],
) -> Models:
    """Parameters of every sample by least squares over two equations a point; NaN if singular."""
    count, points, axes = ground.shape
    size = axes + 1
    design = np.zeros((count, 2 * points, 2 * size + axes))
    for axis in range(2):
        rows = slice(axis, 2 * points, 2)
        design[:, rows, size * axis : size * axis + axes] = ground
        design[:, rows, size * axis + axes] = 1.0
        design[:, rows, 2 * size :] = -image[:, :, axis : axis + 1] * ground
    right = image.reshape(count, 2 * points, 1)
    normal = np.swapaxes(design, 1, 2) @ design
    # design: coordinates are of unit spread, so that it only keeps singular samples solvable.
    normal += 1e-12 * np.eye(design.shape[2])
    return np.linalg.solve(normal, np.swapaxes(design, 1, 2) @ right)[:, :, 0]


def distances(
    models: Models,
    ground: Float64[np.ndarray, "n axes"],
    image: Float64[np.ndarray, "n 2"],
) -> Float64[np.ndarray, "samples n"]:
    """Distance between where every model puts every point and where it is."""
    across, down = places_by(models, ground)
    return np.nan_to_num(np.hypot(across - image[:, 0], down - image[:, 1]), nan=np.inf)


def places_by(
    models: Models, ground: Float64[np.ndarray, "n axes"]
) -> tuple[Float64[np.ndarray, "samples n"], Float64[np.ndarray, "samples n"]]:
    """Where every model puts every point, across and down; NaN where it has no place."""
    whole = np.column_stack([ground, np.ones(len(ground))])
    size = whole.shape[1]
    depth = models[:, 2 * size :] @ ground.T + 1.0
    # design: a point in the plane of the camera has no place in the picture.
    depth = np.where(np.abs(depth) < 1e-9, np.nan, depth)
    across, down = models[:, :size] @ whole.T, models[:, size : 2 * size] @ whole.T
    return across / depth, down / depth


def is_flat(heights: Scalars, flying_height_m: float) -> bool:
    """Whether the relief of the points is too low for eleven parameters."""
    return bool(np.ptp(heights) < LEAST_RELIEF * flying_height_m) if len(heights) else True
