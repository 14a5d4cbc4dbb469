"""A block without a reference ortho, positioned by ties and by the priors of its sources.

Each connected part becomes one body (`core.localisation.free_block`) and is then adjusted with the
exterior orientations its sources give as weighted observations. Until surveyed points are
measured, it is no more accurate than those.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.positioning import MEASURED_M, MEASURED_RAD
from core.block import Block, Photo
from core.doubts import Doubt
from core.geometry.exterior import ExteriorOrientation
from core.localisation.free_block import FreeBlock, free_blocks
from core.said import say


def stand_by_ties(
    block: Block,
    hypotheses: Mapping[str, Sequence[ExteriorOrientation]],
    options: AdjustmentOptions,
) -> tuple[Block, tuple[Doubt, ...]]:
    """The photos where their ties and their sources put them, and a doubt for each left out.

    A photo is oriented when ties hold it to others, or when its exterior orientation was measured
    in flight.

    Args:
        block: Photos with approximate orientations and priors, and rough ties.
        hypotheses: By photo, all orientations its source leaves open.
        options: The adjustment.
    """
    photos = {
        name: _begun(photo, part)
        for part in free_blocks(block, hypotheses, options)
        for name, photo in part.block.photos.items()
    }
    standing = block.with_photos(photos)
    # Steps that did not settle were better all the same.
    standing = standing.with_photos(adjusted_by_ties(standing, options).block.photos)
    doubts = [_left_out(name) for name, photo in standing.photos.items() if not photo.oriented]
    return standing, tuple(doubts)


def adjusted_by_ties(block: Block, options: AdjustmentOptions) -> AdjustmentReport:
    """The block adjusted by its ties and priors, the cameras held."""
    return adjust_block(block, replace(options, estimate_cameras=False))


def on_tied_ground(block: Block, options: AdjustmentOptions) -> Block:
    """The block with the mean height under each photo that its tie points tell.

    Photos without tie points lie over the mean of all.
    """
    heights = adjusted_by_ties(block, options).tie_positions[:, 2]
    if not np.isfinite(heights).any():
        return block
    own = heights[block.ties.point]
    photos: dict[str, Photo] = {}
    for name, photo in block.photos.items():
        seen = (
            []
            if name not in block.ties.photo_ids
            else own[block.ties.photo == block.ties.photo_ids.index(name)]
        )
        known = np.asarray(seen)[np.isfinite(seen)]
        level = np.median(known) if len(known) else np.nanmedian(heights)
        photos[name] = replace(photo, ground_height_m=float(level))
    return block.with_photos(photos)


def is_measured(photo: Photo) -> bool:
    """Whether both centre and angles of a photo are known as GNSS and IMU know them."""
    return bool(
        np.all(photo.prior.sigma_centre_m <= MEASURED_M)
        and np.all(photo.prior.sigma_angles <= MEASURED_RAD)
    )


def _begun(photo: Photo, part: FreeBlock) -> Photo:
    """A photo as the adjustment begins: as it was measured in flight, else as ties have it."""
    if is_measured(photo):
        return photo.with_exterior(photo.approximate, True)
    return replace(photo, oriented=part.tied)


def _left_out(name: str) -> Doubt:
    """The doubt of a photo that nothing holds."""
    message = say(
        "Photo {name} is not tied to any other, and its source says only roughly where it lies; it "
        "is left out until four surveyed points are measured in it.",
        name=name,
    )
    # design: as a photo that is left out on a reference.
    return Doubt("photo-orientation", name, message, 0.9)
