"""What a block cannot be adjusted from, or only badly: named before and after, never a crash."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial import KDTree

from core.arrays import Position
from core.block.block import Block, Measurement, SurveyedPoint
from core.doubts import Doubt

FAR = 20.0
"""A control point further from a photo than this many heights over ground was never in it."""
SAME_PLACE_M = 0.01
"""Control points nearer to each other than this are one and the same."""
SAME_PIXEL = 0.1
"""Measurements nearer to each other than this, in pixels, are one and the same."""

Key = tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Sound:
    """A block without what no adjustment can use."""

    block: Block
    """The block to adjust; impossible measurements are `unused` in it."""
    reasons: Mapping[Key, str]
    """Measurements that were taken out, with the reason in words."""
    doubts: tuple[Doubt, ...]
    """The same as doubts."""


def examined(block: Block) -> Sound:
    """Take out coordinates, measurements and sigmas that cannot be, and say so."""
    control = {
        key: item
        for key, item in block.measurements.items()
        if item.used and block.surveyed[key[0]].role == "control"
    }
    reasons: dict[Key, str] = {}
    doubts: list[Doubt] = []
    for check in (_impossible, _far_away, _twice):
        found = check(block, {key: m for key, m in control.items() if key not in reasons})
        reasons |= found
    doubts += _told(reasons)
    doubts += _without_sigma(block, control)
    if not reasons:
        return Sound(block, reasons, tuple(doubts))
    out = {
        key: replace(block.measurements[key], status="unused", reason=why)
        for key, why in reasons.items()
    }
    sound = replace(block, measurements={**block.measurements, **out})
    return Sound(sound, reasons, tuple(doubts))


def _impossible(block: Block, control: Mapping[Key, Measurement]) -> dict[Key, str]:
    """Numbers that are none."""
    reasons: dict[Key, str] = {}
    for key, item in control.items():
        point = block.surveyed[key[0]]
        if not np.isfinite([*point.position, *point.sigma_m]).all():
            reasons[key] = "A coordinate of the point or its standard deviation is no number."
        elif not np.isfinite([item.column, item.row, item.sigma_px]).all():
            reasons[key] = "The measurement or its standard deviation is no number."
    return reasons


def _far_away(block: Block, control: Mapping[Key, Measurement]) -> dict[Key, str]:
    """Control points that no photo can have shown."""
    reasons: dict[Key, str] = {}
    for key in control:
        photo, point = block.photos[key[1]], block.surveyed[key[0]]
        above = max(abs(float(photo.approximate.centre[2]) - photo.ground_height_m), 10.0)
        reach = FAR * above + 3 * float(np.max(photo.prior.sigma_centre_m))
        distance = float(np.linalg.norm(point.position - photo.approximate.centre))
        if photo.oriented and distance > reach:
            reasons[key] = (
                f"The point lies {distance / 1000:,.0f} km from where the photo was taken; "
                "look at its coordinates and their CRS."
            )
    return reasons


def _twice(block: Block, control: Mapping[Key, Measurement]) -> dict[Key, str]:
    """Measurements of one place under two names: the second would count as a check on the first."""
    by_photo: dict[str, list[Measurement]] = defaultdict(list)
    for item in control.values():
        by_photo[item.photo_id].append(item)
    reasons: dict[Key, str] = {}
    for items in by_photo.values():
        if len(items) < 2:
            continue
        tree = KDTree([(item.column, item.row) for item in items])
        for first, second in sorted(tree.query_pairs(SAME_PIXEL)):
            one, other = items[first], items[second]
            gap = block.surveyed[one.point_id].position - block.surveyed[other.point_id].position
            if float(np.linalg.norm(gap)) < SAME_PLACE_M:
                reasons[other.key] = (
                    f"It is the point {one.point_id} once more, under another name."
                )
    return reasons


def _told(reasons: Mapping[Key, str]) -> list[Doubt]:
    """One doubt for each point that lost measurements."""
    kinds = (
        ("once more", "duplicate-points", 0.4),
        ("km from", "control-far-away", 0.8),
        ("no number", "impossible-number", 0.8),
    )
    found: dict[str, Doubt] = {}
    for (name, photo), why in reasons.items():
        kind, gravity = next((kind, gravity) for word, kind, gravity in kinds if word in why)
        found.setdefault(name, Doubt(kind, name, why, gravity, {"scan": photo}))
    return list(found.values())


def _without_sigma(block: Block, control: Mapping[Key, Measurement]) -> list[Doubt]:
    """Standard deviations of nought and below: nothing is known that well."""
    points = {key[0] for key in control}
    names = sorted(n for n in points if _has_none(block.surveyed[n]))
    rays = [item for item in control.values() if item.sigma_px <= 0]
    ties = int(np.sum(block.ties.sigma_px <= 0))
    found: list[Doubt] = []
    if names:
        message = (
            f"{len(names)} control points have a standard deviation of nought. They are held to "
            "0.1 mm, so that an error in one bends the block; give what they are really worth."
        )
        found.append(Doubt("sigma-nought-given", names[0], message, 0.4, {"points": names[:20]}))
    if rays or ties:
        message = (
            f"{len(rays) + ties} measurements have a standard deviation of nought or less; they "
            "are taken as good to 0.001 pixel."
        )
        found.append(Doubt("sigma-nought-given", "measurements", message, 0.6))
    return found


def _has_none(point: SurveyedPoint) -> bool:
    return bool((point.sigma_m <= 0).any())


def control_doubts(
    plan: Float64[np.ndarray, "points 3"],
    heights: Float64[np.ndarray, "others 3"],
    centres: Float64[np.ndarray, "photos 3"],
    side_m: float,
    measured_centres: int,
) -> list[Doubt]:
    """What is doubtful about where the control lies.

    Args:
        plan: Points known in plan, metres.
        heights: Points known in height, metres.
        centres: Perspective centres, metres.
        side_m: Side of the ground one photo shows, metres.
        measured_centres: Photos whose centre was measured in flight: they stand for control.
    """
    if measured_centres >= 3 and _spread(centres)[1] > 0.1 * side_m:
        return []
    if not len(plan) and not len(heights):
        message = "No control takes part: place, scale and tilt rest on the approximate positions."
        return [Doubt("no-control", "block", message, 0.9)]
    if len(plan) < 2 or len(heights) < 3:
        message = (
            f"{len(plan)} points known in plan and {len(heights)} in height do not fix a block: "
            "two and three are needed, more to check them. The rest comes from the approximate "
            "positions."
        )
        return [Doubt("control-too-few", "block", message, 0.9)]
    long, short = _spread(heights)
    evidence = {"along_m": long, "across_m": short}
    if short < 0.05 * max(long, side_m):
        message = (
            f"All height control lies on a line (within {short:.0f} m of it, {long:.0f} m long): "
            "the block can turn about it. A point off the line would hold it."
        )
        return [Doubt("control-on-a-line", "block", message, 0.9, evidence)]
    return _in_one_corner(plan, heights, centres, side_m)


def _in_one_corner(
    plan: Float64[np.ndarray, "points 3"],
    heights: Float64[np.ndarray, "others 3"],
    centres: Float64[np.ndarray, "photos 3"],
    side_m: float,
) -> list[Doubt]:
    """Control in a small part of the block: errors grow with the distance from it."""
    both = np.concatenate([plan, heights])[:, :2]
    low, high = centres[:, :2].min(axis=0) - side_m / 2, centres[:, :2].max(axis=0) + side_m / 2
    share = float(np.prod((np.ptp(both, axis=0) + 1.0) / (high - low)))
    if share > 0.15:
        return []
    message = (
        f"All control lies in {100 * share:.0f} % of the block's area: the same number of points "
        "spread over it would be several times as good at the far edge."
    )
    return [Doubt("control-in-one-corner", "block", message, 0.8, {"share": share})]


def _spread(points: Float64[np.ndarray, "points 3"]) -> tuple[float, float]:
    """Extent in plan along the longest direction and across it, metres."""
    if len(points) < 2:
        return 0.0, 0.0
    offset = points[:, :2] - points[:, :2].mean(axis=0)
    directions: Position = np.linalg.svd(offset, full_matrices=False)[2]
    turned = offset @ directions.T
    return float(np.ptp(turned[:, 0])), float(np.ptp(turned[:, 1])) if turned.shape[1] > 1 else 0.0
