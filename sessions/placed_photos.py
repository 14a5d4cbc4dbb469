"""Photos that operators placed by clicks; the next run begins from these positions."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from core.block import Block, Measurement
from core.errors import PhotogrammetryError
from core.georeference.approximation import Ground, approximate_from_points
from core.georeference.archive import Pairs, clicked_points
from core.results import BlockInput
from core.said import say
from sessions.decisions import PlacePhoto, Recorded, standing

SAME_M = 0.01  # design: rounding; clicks differ by far more
"""Two places of a perspective centre no further apart are the same."""


def clicked_pairs(decisions: Sequence[Recorded]) -> dict[str, Pairs]:
    """The pairs of every photo as they were clicked last; none of those that were given back."""
    said = (item.decision for item in standing(decisions))
    last = {one.photo_id: one.pairs for one in said if isinstance(one, PlacePhoto)}
    return {name: pairs for name, pairs in last.items() if pairs}


def with_clicks(given: BlockInput, decisions: Sequence[Recorded]) -> BlockInput:
    """The block as its owner describes it, with photos placed at the desk."""
    clicked = clicked_pairs(decisions)
    if not clicked:
        return given
    return replace(given, georeference=replace(given.georeference, clicked=clicked))


def with_placed(block: Block, decisions: Sequence[Recorded]) -> Block:
    """The block with every photo that was placed by clicks where those put it."""
    for photo_id, pairs in clicked_pairs(decisions).items():
        if photo_id in block.photos:
            block = place_photo_again(block, photo_id, pairs)
    return block


def place_photo_again(block: Block, photo_id: str, pairs: Pairs) -> Block:
    """The block with one photo where its clicks put it.

    A photo that the run began from these very clicks, and found its place, is left as it is.
    Else what the program measured in it was measured at another place, and is left out; what an
    operator stands by stays.
    """
    photo = block.photos[photo_id]
    ground = Ground(block.crs, photo.ground_height_m)
    points = clicked_points(photo.scan, block.crs, pairs)
    try:
        found = approximate_from_points(points, photo.interior, block.camera_of(photo_id), ground)
    except PhotogrammetryError:
        # Only what can be placed is recorded; a film turned since may say otherwise.
        return block
    away = np.hypot(*(photo.approximate.centre - found.exterior.centre)[:2])
    if away < SAME_M and photo.oriented:
        return block
    ties = block.ties
    placed = replace(
        photo, exterior=found.exterior, approximate=found.exterior, prior=found.prior, oriented=True
    )
    left_out = {
        key: _left_out(item)
        for key, item in block.measurements.items()
        if item.photo_id == photo_id and item.status == "auto"
    }
    return replace(
        block.with_photos({**block.photos, photo_id: placed}),
        measurements={**block.measurements, **left_out},
        ties=ties
        if photo_id not in ties.photo_ids
        else ties.kept(ties.photo != ties.photo_ids.index(photo_id)),
    )


def _left_out(item: Measurement) -> Measurement:
    reason = say("its photo was placed by hand since: a new run finds it again")
    return replace(item, status="unused", reason=reason)
