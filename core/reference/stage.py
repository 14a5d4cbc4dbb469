"""Stage reference: the junctions and salient points of today's ground that photos may show."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from core.arrays import ObjectPoints
from core.block import Block, ShiftedReference, Source
from core.doubts import Doubt
from core.formats.roads import Roads, read_roads
from core.formats.vectors import read_mask_polygons
from core.geometry.crs import Bounds, read_crs
from core.matching.patches import OpenPhoto
from core.matching.reference import (
    Reference,
    ReferenceFiles,
    ReferenceLayer,
    layers_near,
    open_reference,
)
from core.progress import Progress, Work
from core.raster.scan_file import ScanFile
from core.reference.junctions import Junction, find_junctions
from core.reference.road_graph import planar_graph
from core.reference.salient import TEMPLATE_PX, SalientPoint, find_salient_points
from core.said import say

# design: 12 x 12 places are enough to orient a photo where only one in four is found.
CELLS_ACROSS = 12
"""Cells along the shorter side of a photo in which points are wanted."""
ALONE = "-r"
"""Between the name of a place and the number of the reference that shows it besides today's."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferencePoints:
    """Points of the reference to be found in the photos, as parallel arrays."""

    ids: tuple[str, ...]
    """Names."""
    positions: ObjectPoints
    """Where they are, metres."""
    sigma_m: ObjectPoints
    """Standard deviations per axis, metres, change between the epochs included."""
    shifted: ShiftedReference | None = field(default=None, metadata={"later": True})
    """What they may all be off together; None where they define the datum."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceFeatures:
    """The points of the reference, and where each comes from."""

    points: ReferencePoints
    """Places and accuracies."""
    sources: dict[str, Source]
    """Junction or salient, by name."""
    doubts: tuple[Doubt, ...] = ()
    """Layers that give nothing here: roads, masks, bridges."""
    each_alone: "tuple[ReferenceFeatures, ...]" = field(default=(), metadata={"later": True})
    """Where photos are tied to several orthos, the points of each by itself, for control."""


def find_reference_points(
    block: Block,
    scans: Mapping[str, ScanFile],
    files: ReferenceFiles,
    finest_gsd_m: float,
    *,
    work: Work,
) -> ReferenceFeatures:
    """Junctions of the roads, and salient points of the ortho where those are few.

    Without an ortho there is nothing to compare a photo with, and no point is found.

    Args:
        block: Photos where the archive puts them, with what that may be off.
        scans: Scans by photo.
        files: The reference.
        finest_gsd_m: Finer detail is not looked at, metres.
        work: Progress and threads.

    Raises:
        PhotogrammetryError: A file of the reference cannot be used.
    """
    if not files.ortho:
        return join_points((), ())
    bounds = block.search_bounds
    roads = read_roads(files.roads, files.crs, bounds)
    sizes = [
        (opened.width_m, opened.ground_pixel_m)
        for name, photo in block.photos.items()
        for opened in [OpenPhoto(photo, block.camera_of(name), scans[name])]
    ]
    width, pixel = np.median(np.array(sizes), axis=0)
    gsd = max(float(pixel), finest_gsd_m)
    mask = _polygons(files.mask, files, bounds)

    def gathered(own: ReferenceFiles, part: Work) -> ReferenceFeatures:
        reference = open_reference(own, bounds)
        junctions = junctions_of(roads, reference, own, bounds)
        return gather_reference_points(
            reference,
            junctions,
            bounds,
            float(width),
            gsd_m=gsd,
            mask=mask,
            progress=part.progress,
            mapper=part.mapper,
        )

    alone = files.each_alone
    parts = [work.part(k / (len(alone) + 1), (k + 1) / (len(alone) + 1)) for k in range(len(alone))]
    each = [
        _of_layer(gathered(own, part), layer, number)
        for number, ((layer, own), part) in enumerate(zip(alone, parts, strict=True), start=1)
    ]
    features = gathered(files, work.part(len(alone) / (len(alone) + 1), 1.0) if alone else work)
    away = (*_elsewhere(files, bounds), *_layers_elsewhere(files, bounds))
    return replace(features, doubts=(*roads.notes, *away), each_alone=tuple(each))


def _of_layer(features: ReferenceFeatures, layer: ReferenceLayer, number: int) -> ReferenceFeatures:
    """The points of one of several orthos; what does not define the datum has names of its own."""
    if layer.datum:
        return features
    own = {name: f"{name}{ALONE}{number}" for name in features.points.ids}
    points = replace(features.points, ids=tuple(own.values()), shifted=layer.shifted)
    return replace(
        features,
        points=points,
        sources={own[name]: source for name, source in features.sources.items()},
    )


def junctions_of(
    roads: Roads, reference: Reference, files: ReferenceFiles, bounds: Bounds
) -> tuple[Junction, ...]:
    """Junctions of the roads within bounds (west, south, east, north, metres)."""
    return find_junctions(
        planar_graph(roads), reference.dem,
        sigmas_m=reference.sigmas_m, bounds=bounds,
        mask=_polygons(files.mask, files, bounds),
        bridges=_polygons(files.bridges, files, bounds),
    )  # fmt: skip


def _polygons(path: Path | None, files: ReferenceFiles, bounds: Bounds) -> BaseGeometry | None:
    crs = read_crs(files.crs, "block.toml")
    return read_mask_polygons(path, crs, bounds) if path else None


def _elsewhere(files: ReferenceFiles, bounds: Bounds) -> tuple[Doubt, ...]:
    """Files of polygons that have none in the block, perhaps since they say another CRS."""
    given = {"mask": files.mask, "bridges": files.bridges}
    crs = read_crs(files.crs, "block.toml")
    return tuple(
        Doubt(
            "polygons-elsewhere",
            str(path),
            say(
                "[reference] {key}: no polygon of {name} lies in the block. It may be empty, or "
                "in another CRS than it says.",
                key=key,
                name=path.name,
            ),
        )
        for key, path in given.items()
        if path is not None and read_mask_polygons(path, crs, bounds).is_empty
    )


def _layers_elsewhere(files: ReferenceFiles, bounds: Bounds) -> tuple[Doubt, ...]:
    """Layers that photos should be tied to, and of which nothing lies in the block."""
    near = layers_near(files, bounds)
    return tuple(
        Doubt(
            "reference-elsewhere",
            one.name,
            say(
                "{name} does not reach the block, so no photo is tied to it. Check its CRS, or "
                "leave ties out.",
                name=one.name,
            ),
        )
        for one in files.layers
        if one not in near
    )


def gather_reference_points(
    reference: Reference,
    junctions: tuple[Junction, ...],
    bounds: Bounds,
    photo_width_m: float,
    *,
    gsd_m: float,
    mask: BaseGeometry | None,
    progress: Progress,
    mapper: Callable[..., Iterable[Any]] = map,
) -> ReferenceFeatures:
    """Junctions with a height, and salient points where junctions are missing or few.

    Args:
        reference: Ortho and heights.
        junctions: Road junctions within the block.
        bounds: West, south, east, north of the block, metres.
        photo_width_m: Shorter side of a photo on the ground, metres.
        gsd_m: Ground sample distance of the scans, metres.
        mask: Area where nothing may be matched.
        progress: Told as the ortho is looked through.
        mapper: Runs a function over parts of the ortho.
    """
    # Sizes in steps, so that a georeference whose scale is a little off leads to the same points.
    finest = reference.ortho.ground_sample_distance_m
    gsd = finest * in_steps(max(gsd_m / finest, 1.0))
    template_m = TEMPLATE_PX * gsd
    # design: templates of neighbours overlap by a quarter at most.
    spacing = template_m * in_steps(max(photo_width_m / CELLS_ACROSS / template_m, 0.75))
    places = np.array([junction.position[:2] for junction in junctions]).reshape(-1, 2)
    salient = find_salient_points(
        reference, bounds, spacing,
        gsd_m=gsd, existing=places, mask=mask, progress=progress, mapper=mapper,
    )  # fmt: skip
    return join_points(junctions, salient)


def in_steps(ratio: float) -> float:
    """The power of a fourth root of two that is nearest to a ratio."""
    return float(2 ** (np.round(4 * np.log2(ratio)) / 4))


def join_points(
    junctions: tuple[Junction, ...], salient: tuple[SalientPoint, ...]
) -> ReferenceFeatures:
    """Both kinds as parallel arrays; a name given twice is taken once."""
    sources: dict[str, Source] = {}
    rows: list[tuple[np.ndarray, np.ndarray]] = []
    for junction in junctions:
        if junction.junction_id not in sources:
            sources[junction.junction_id] = "junction"
            rows.append((junction.position, junction.sigma_m))
    for point in salient:
        if point.point_id not in sources:
            sources[point.point_id] = "salient"
            rows.append((point.position, point.sigma_m))
    positions = np.array([row[0] for row in rows]).reshape(-1, 3)
    sigma = np.array([row[1] for row in rows]).reshape(-1, 3)
    return ReferenceFeatures(ReferencePoints(tuple(sources), positions, sigma), sources)
