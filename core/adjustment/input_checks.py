"""Input that no adjustment can use: left out beforehand and reported, never a crash."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from core.block import Block, Measurement, SurveyedPoint
from core.doubts import Doubt
from core.said import say

FAR = 20.0  # design: at a tilt of 87 degrees a photo still shows less.
"""A control point further from a photo than this many heights over ground was never in it."""
SAME_PLACE_M = 0.01  # design: no point of a reference is told apart by a centimetre.
"""Control points nearer to each other than this are one and the same."""
SAME_PIXEL = 0.1  # design: below what any point is measured to.
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


def check_input(block: Block) -> Sound:
    """Take out coordinates, measurements and sigmas that cannot be, and say so."""
    control = {
        key: item
        for key, item in block.measurements.items()
        if item.used and block.surveyed[key[0]].role != "check"
    }
    reasons: dict[Key, str] = {}
    doubts: list[Doubt] = []
    for check in (_impossible, _far_away, _twice):
        found = check(block, {key: m for key, m in control.items() if key not in reasons})
        reasons |= found
    doubts += _doubts_of(reasons)
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
            if _of_two_references(block, one, other):
                continue
            gap = block.surveyed[one.point_id].position - block.surveyed[other.point_id].position
            if float(np.linalg.norm(gap)) < SAME_PLACE_M:
                reasons[other.key] = (
                    f"It is the point {one.point_id} once more, under another name."
                )
    return reasons


def _of_two_references(block: Block, one: Measurement, other: Measurement) -> bool:
    """Whether two orthos were compared with the same place: each says something of its own."""
    return block.surveyed[one.point_id].shifted != block.surveyed[other.point_id].shifted


def _doubts_of(reasons: Mapping[Key, str]) -> list[Doubt]:
    """One doubt for each point that lost measurements."""
    kinds = {
        "once more": "duplicate-points",
        "km from": "control-far-away",
        "no number": "impossible-number",
    }
    found: dict[str, Doubt] = {}
    for (name, photo), why in reasons.items():
        kind = next(kind for word, kind in kinds.items() if word in why)
        found.setdefault(name, Doubt(kind, name, why, evidence={"scan": photo}))
    return list(found.values())


def _without_sigma(block: Block, control: Mapping[Key, Measurement]) -> list[Doubt]:
    """Standard deviations of nought and below: nothing is known that well."""
    points = {key[0] for key in control}
    names = sorted(n for n in points if _has_none(block.surveyed[n]))
    rays = [item for item in control.values() if item.sigma_px <= 0]
    ties = int(np.sum(block.ties.sigma_px <= 0))
    found: list[Doubt] = []
    if names:
        message = say(
            "{count} control points have a standard deviation of nought. They are held "
            "to 0.1 mm, so that an error in one bends the block; give what they are "
            "really worth.",
            count=len(names),
        )
        found.append(
            Doubt("sigma-nought-given", names[0], message, evidence={"points": names[:20]})
        )
    if rays or ties:
        message = say(
            "{count} measurements have a standard deviation of nought or less; they are "
            "taken as good to 0.001 pixel.",
            count=len(rays) + ties,
        )
        # design: it drowns all others.
        found.append(Doubt("sigma-nought-given", "measurements", message, 0.6))
    return found


def _has_none(point: SurveyedPoint) -> bool:
    return bool((point.sigma_m <= 0).any())
