"""Lay a verdict on a tie point, a photo or a fiducial over a block."""

from dataclasses import replace

import numpy as np

from core.block.block import Block, TiePoints
from core.doubts import Failure
from core.geometry.interior import fit_interior
from sessions.decisions import JudgeFiducial, JudgePhoto, JudgeTie

SAME_RAY_PX = 1.0
"""Two rays of a photo nearer than this, scan pixels, are the same."""


def judged(block: Block, decision: JudgeTie | JudgePhoto | JudgeFiducial) -> Block | None:
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
        case JudgeFiducial():
            return _with_fiducial(block, decision)


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


def _with_fiducial(block: Block, decision: JudgeFiducial) -> Block | None:
    """The interior orientation without a wrong mark; as it is where too few would be left."""
    photo = block.photos.get(decision.photo_id)
    if photo is None or decision.name not in photo.interior.names:
        return None
    if decision.use:
        return block
    interior = photo.interior
    keep = [i for i, name in enumerate(interior.names) if name != decision.name]
    certified = interior.film_from_pixel(interior.pixels) - interior.residuals_um / 1000
    names = [interior.names[i] for i in keep]
    fitted = fit_interior(names, interior.pixels[keep], certified[keep])
    if isinstance(fitted, Failure):
        return None
    without = replace(photo, interior=fitted)
    return block.with_photos({**block.photos, decision.photo_id: without})
