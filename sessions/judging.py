"""Lay a verdict on a tie point or a photo over a block."""

from dataclasses import replace

import numpy as np

from core.block import Block, TiePoints
from sessions.decisions import JudgePhoto, JudgeTie

SAME_RAY_PX = 1.0
"""Two rays of a photo nearer than this, scan pixels, are the same."""


def judged(block: Block, decision: JudgeTie | JudgePhoto) -> Block | None:
    """The block after the verdict; None when what it is about is not in this block."""
    match decision:
        case JudgeTie():
            return _with_tie(block, decision)
        case JudgePhoto(photo_id=photo_id, use=use):
            photo = block.photos.get(photo_id)
            if photo is None:
                return None
            # A photo that was never placed cannot be used because somebody says so.
            kept = replace(photo, oriented=photo.oriented and use)
            return block.with_photos({**block.photos, photo_id: kept})


def tie_at(ties: TiePoints, photo_id: str, column: float, row: float) -> int | None:
    """Number of the tie point that has a ray at a pixel of a photo; None without one."""
    if photo_id not in ties.photo_ids:
        return None
    rays = np.flatnonzero(ties.photo == ties.photo_ids.index(photo_id))
    away = np.hypot(*(ties.pixels[rays] - (column, row)).T)
    if not len(away) or float(away.min()) > SAME_RAY_PX:
        return None
    return int(ties.point[rays[int(np.argmin(away))]])


def _with_tie(block: Block, decision: JudgeTie) -> Block | None:
    """Without the rays of a wrong tie point; the others keep their numbers."""
    ties = block.ties
    number = tie_at(ties, decision.photo_id, decision.column, decision.row)
    if number is None:
        return None
    if decision.use:
        return block
    kept = ties.point != number
    fewer = TiePoints(
        ties.photo_ids, ties.point[kept], ties.photo[kept], ties.pixels[kept], ties.sigma_px[kept]
    )
    return replace(block, ties=fewer)
