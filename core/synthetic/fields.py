"""Parcels: the land between the roads, cut into tracts and those into strips, epoch by epoch."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
import shapely.ops
from jaxtyping import Float32
from scipy import ndimage
from shapely.geometry import LineString, Polygon

from core.arrays import locked
from core.synthetic.network import Network
from core.synthetic.options import seeded
from core.synthetic.terrain import PlanPoints

Cover = Literal["arable", "meadow", "orchard", "garden"]
PROFILE_STEP_M = 0.125
PROFILE_LENGTH = 65536
"""A profile repeats after 8 km, and every tract begins somewhere else in it."""
STRIPS, GARDENS, BROAD, PLAIN = 0, 1, 2, 3


@dataclass(frozen=True, slots=True, eq=False)
class Tract:
    """Land ploughed in one direction: its strips follow from a profile across that direction."""

    outline: PlanPoints
    """Boundary (easting, northing), metres."""
    cover: Cover
    """What grows there."""
    profile: int
    """Row of the profile table."""
    offset_m: float
    """Where in the profile the tract begins."""
    across: tuple[float, float]
    """Unit vector across the strips."""
    tone: float
    """Mean gray, 0 to 255."""
    contrast: float
    """Factor on the profile."""
    mottle: float
    """Factor on the irregular texture."""
    tint: tuple[float, float, float]
    """Colour, red, green, blue, of mean luminance 1."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "outline", locked(self.outline))


def make_tracts(
    network: Network, past: bool, change: float, recency: float, seed: int
) -> list[Tract]:
    """All tracts of one epoch; land whose bounds did not change keeps its tracts and strips.

    Args:
        network: Roads of both epochs.
        past: The archival epoch, or the present.
        change: Share of the land that was parcelled anew although its roads stayed.
        recency: 0 where the old epoch lies before the consolidation of land, 1 where after it.
        seed: Seed of the block.

    Returns:
        Tracts that cover all land enclosed by roads.
    """
    tracts: list[Tract] = []
    for face in _faces(network, past):
        centre = np.array([[face.centroid.x, face.centroid.y]])
        key = f"{centre[0, 0]:.1f} {centre[0, 1]:.1f}"
        stayed = seeded(seed, "stayed", key).random() > change
        # Bounds and direction of unchanged land come from a generator without the epoch.
        shape = seeded(seed, "tracts", key, "both" if stayed else past)
        crops = seeded(seed, "crops", key, past)
        consolidated = seeded(seed, "consolidated", key).random() < 0.75 * recency
        small = (past or stayed) and not consolidated
        garden = float(network.village_distance(centre)[0]) < 40.0
        for piece in _halved(face, shape.uniform(2.5e4, 7e4) if small else 2.4e5, shape):
            tracts.append(_tract(piece, small, garden, past, shape, crops))
    return tracts


def _faces(network: Network, past: bool) -> list[Polygon]:
    """Land enclosed by the roads of an epoch; worn roads keep their bounds, moved ones do not."""
    lines = [
        LineString(road.then if past and road.moved else road.now)
        for road in network.roads
        if road.exists(past)
    ]
    noded = shapely.get_parts(shapely.unary_union(lines))
    faces = shapely.get_parts(shapely.polygonize(noded))
    return sorted(
        (face for face in faces if face.area > 200.0), key=lambda f: (f.centroid.x, f.centroid.y)
    )


def _halved(face: Polygon, limit_m2: float, rng: np.random.Generator) -> list[Polygon]:
    """The face cut across its longer side until no piece is larger than the limit."""
    if face.area < limit_m2:
        return [face]
    along, _ = _long_axis(face)
    middle = np.array([face.centroid.x, face.centroid.y])
    middle += along * rng.uniform(-0.1, 0.1) * np.sqrt(face.area)
    turn = rng.normal(0.0, 0.12)
    across = np.array([-along[1], along[0]]) + turn * along
    reach = 4.0 * float(np.hypot(*(np.array(face.bounds[2:]) - np.array(face.bounds[:2]))))
    knife = LineString([middle - across * reach, middle + across * reach])
    pieces = [p for p in shapely.ops.split(face, knife).geoms if isinstance(p, Polygon)]
    if len(pieces) < 2:
        return [face]
    return [part for piece in pieces for part in _halved(piece, limit_m2, rng)]


def _long_axis(face: Polygon) -> tuple[np.ndarray, float]:
    """Unit vector along the longer side of the smallest rectangle about a face, and its length."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(face))
    sides = np.diff(corners[:3], axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    longer = int(np.argmax(lengths))
    return sides[longer] / max(float(lengths[longer]), 1e-9), float(lengths[longer])


def _tract(
    piece: Polygon,
    small: bool,
    garden: bool,
    past: bool,
    shape: np.random.Generator,
    crops: np.random.Generator,
) -> Tract:
    along, _ = _long_axis(piece)
    if shape.random() < 0.3:
        along = np.array([-along[1], along[0]])
    turn = shape.normal(0.0, 0.05)
    across = np.array([-along[1] + turn * along[0], along[0] + turn * along[1]])
    across /= np.linalg.norm(across)
    offset = float(shape.uniform(0.0, PROFILE_LENGTH * PROFILE_STEP_M))
    lot = float(shape.random())
    cover: Cover = "arable" if lot < 0.77 else "meadow" if lot < 0.94 else "orchard"
    cover = "garden" if garden else cover
    kind = {"arable": STRIPS if small else BROAD, "garden": GARDENS}.get(cover, PLAIN)
    tone, contrast, mottle, tint = _look(cover, past, small, crops)
    return Tract(
        shapely.get_coordinates(piece.exterior),
        cover,
        2 * kind + past,
        offset,
        (float(across[0]), float(across[1])),
        tone,
        contrast,
        mottle,
        tint,
    )


def _look(
    cover: Cover, past: bool, small: bool, rng: np.random.Generator
) -> tuple[float, float, float, tuple[float, float, float]]:
    """Tone, contrast of the strips, mottle and tint of a tract."""
    green, soil, straw = (0.93, 1.06, 0.82), (1.1, 0.98, 0.84), (1.08, 1.02, 0.76)
    if cover == "arable":
        tone = rng.normal(132.0, 16.0 if small else 27.0)
        tint = (green, soil, straw)[int(rng.integers(3))]
        return float(np.clip(tone, 70, 200)), float(rng.uniform(0.6, 1.25)), 1.0, tint
    if cover == "garden":
        return float(rng.normal(118.0, 12.0)), float(rng.uniform(0.7, 1.2)), 1.6, green
    mean = 112.0 if past else 122.0
    return float(rng.normal(mean, 12.0)), 1.0, float(rng.uniform(1.0, 1.9)), green


def make_profiles(seed: int, texture_m: float) -> Float32[np.ndarray, "profiles steps"]:
    """Gray across the strips: row 2 k + past of kind k (strips, gardens, broad, plain).

    Strips and gardens have the same bounds in both epochs and other crops; furrows, ridges and
    tramlines always differ.
    """
    rows = []
    widths = {STRIPS: (9.0, 46.0), GARDENS: (6.0, 19.0), BROAD: (90.0, 420.0)}
    for kind in (STRIPS, GARDENS, BROAD, PLAIN):
        for past in (False, True):
            shape = seeded(seed, "strips", kind)
            crops = seeded(seed, "profile", kind, past)
            row = _furrows(crops, past, kind)
            if kind in widths:
                row += _strips(*widths[kind], shape, crops)
            if kind == BROAD:
                row += _tramlines(crops)
            rows.append(
                ndimage.gaussian_filter1d(row, 0.4 * texture_m / PROFILE_STEP_M, mode="wrap")
            )
    return np.array(rows, dtype=np.float32)


def _strips(
    least_m: float, most_m: float, shape: np.random.Generator, crops: np.random.Generator
) -> np.ndarray:
    """Steps of tone from strip to strip with a grass balk between them."""
    row = np.zeros(PROFILE_LENGTH)
    at = 0
    while at < PROFILE_LENGTH:
        width = int(np.exp(shape.uniform(np.log(least_m), np.log(most_m))) / PROFILE_STEP_M)
        row[at : at + width] = np.clip(crops.normal(0.0, 19.0), -48.0, 48.0)
        balk = int(shape.uniform(0.4, 1.1) / PROFILE_STEP_M)
        row[at : at + balk] = crops.uniform(-20.0, 14.0)
        at += width
    return row


def _furrows(rng: np.random.Generator, past: bool, kind: int) -> np.ndarray:
    """Lines of sowing and ploughing: chance smoothed at two widths."""
    fine = rng.standard_normal(PROFILE_LENGTH)
    row = 3.8 * _unit(ndimage.gaussian_filter1d(fine, 3.0, mode="wrap"))
    ridges = rng.standard_normal(PROFILE_LENGTH)
    row += (3.8 if past else 2.5) * _unit(ndimage.gaussian_filter1d(ridges, 14.0, mode="wrap"))
    knots = rng.standard_normal(PROFILE_LENGTH // 256)
    slow = 3.0 * np.interp(
        np.arange(PROFILE_LENGTH) / 256.0, np.arange(len(knots)), knots, period=len(knots)
    )
    return (row + slow) * (0.35 if kind == PLAIN else 1.0)


def _tramlines(rng: np.random.Generator) -> np.ndarray:
    """Pairs of wheel tracks at the working width of the sprayer."""
    row = np.zeros(PROFILE_LENGTH)
    at = 0.0
    while at < PROFILE_LENGTH * PROFILE_STEP_M:
        for wheel in (0.0, 1.9):
            begin = int((at + wheel) / PROFILE_STEP_M)
            row[begin : begin + 5] = rng.uniform(8.0, 26.0)
        at += 21.0
    return row


def _unit(values: np.ndarray) -> np.ndarray:
    return values / values.std()
