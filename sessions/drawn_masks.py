"""Masks that operators drew, applied to scans and block; measurements inside are left out."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.arrays import Flags
from core.block import Block, Measurement, TiePoints
from core.geometry.drawn_mask import DrawnMask, Stroke, drawn_mask
from core.geometry.interior import InteriorOrientation
from core.said import say
from sessions.decisions import DrawMask, PlacePhoto, Recorded, standing

Lying = Mapping[str, tuple[str, InteriorOrientation]]
"""Camera and interior orientation by photo."""


@dataclass(frozen=True, slots=True)
class Inside:
    """What a mask covers of what is in use."""

    control: tuple[Measurement, ...]
    """Measurements the program made: they are left out."""
    held: tuple[Measurement, ...]
    """Measurements an operator stands by: they stay."""
    ties: int
    """Rays of tie points: they are left out."""


def standing_masks(decisions: Sequence[Recorded]) -> tuple[DrawMask, ...]:
    """What stands of all that was drawn, in order."""
    said = (item.decision for item in standing(decisions))
    return tuple(one for one in said if isinstance(one, DrawMask))


def masks_of(drawn: Iterable[DrawMask], lying: Lying) -> dict[str, DrawnMask]:
    """The mask of every photo on which anything was drawn."""
    every = tuple(drawn)
    masks = {
        name: drawn_mask(
            (
                (Stroke(one.outline, one.width, one.hides), one.on_film)
                for one in every
                if one.subject == (camera if one.on_film else name)
            ),
            interior.pixel_from_film,
        )
        for name, (camera, interior) in lying.items()
    }
    return {name: mask for name, mask in masks.items() if mask}


def knows_subject(block: Block, decision: DrawMask | PlacePhoto) -> bool:
    """True when a block has the photo, or photos of the camera."""
    if isinstance(decision, PlacePhoto):
        return decision.photo_id in block.photos
    if not decision.on_film:
        return decision.subject in block.photos
    return any(photo.camera == decision.subject for photo in block.photos.values())


def lying(block: Block) -> Lying:
    """Photos of a block as masks ask for them."""
    return {name: (photo.camera, photo.interior) for name, photo in block.photos.items()}


def with_masks(block: Block, drawn: Iterable[DrawMask]) -> Block:
    """The block with masks on its photos, and without what the program found under them."""
    masks = masks_of(drawn, lying(block))
    photos = {
        name: replace(photo, mask=masks.get(name, DrawnMask()))
        for name, photo in block.photos.items()
    }
    if not masks:
        return (
            block if not any(p.mask for p in block.photos.values()) else block.with_photos(photos)
        )
    covered = inside(block, masks)
    left_out = {
        item.key: replace(
            item,
            status="unused",
            reason=say("it lies in a part of the scan that is masked by hand"),
        )
        for item in covered.control
    }
    return replace(
        block.with_photos(photos),
        measurements={**block.measurements, **left_out},
        ties=block.ties.kept(~_hidden_rays(block.ties, masks)),
    )


def inside(block: Block, masks: Mapping[str, DrawnMask]) -> Inside:
    """What of the block's measurements and ties in use lies in masks."""
    found = [
        item
        for item in block.measurements.values()
        if item.used and item.photo_id in masks and masks[item.photo_id].hides(item.pixel)[0]
    ]
    return Inside(
        tuple(item for item in found if item.status == "auto"),
        tuple(item for item in found if item.status != "auto"),
        int(_hidden_rays(block.ties, masks).sum()),
    )


def _hidden_rays(ties: TiePoints, masks: Mapping[str, DrawnMask]) -> Flags:
    """Which rays of tie points lie in masks."""
    hidden = np.zeros(len(ties.photo), dtype=np.bool_)
    for number, name in enumerate(ties.photo_ids):
        if name in masks:
            own = ties.photo == number
            hidden[own] = masks[name].hides(ties.pixels[own])
    return hidden
