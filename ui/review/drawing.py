"""Masks drawn by hand: the decision a gesture makes, and what the sheet shows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import shapely

from core.block import Block
from core.geometry.drawn_mask import Area, outlines
from sessions.decisions import DrawMask, Recorded, standing
from sessions.scan_decisions import Inside, inside
from ui.review.compare import Drawn
from ui.review.state import DeskState

Part = dict[str, Any]
# design: a stroke round a whole page at a fine zoom has some hundred places.
MOST_PLACES = 5000
"""An outline has no more corners."""


@dataclass(frozen=True, slots=True)
class MaskDrawn:
    """An outline or a stroke of the brush, in pixels of the raw scan."""

    seat_id: str
    photo_id: str
    outline: tuple[tuple[float, float], ...]
    width: float
    hides: bool
    camera: bool
    """Whether it holds for all scans of the camera."""


def mask_from_message(seat_id: str, message: Mapping[str, Any]) -> MaskDrawn:
    """The gesture of a message.

    Raises:
        ValueError: Its outline covers nothing, or is no place on a scan.
    """
    places = cast("list[list[float]]", message["outline"])
    outline = tuple((float(column), float(row)) for column, row in places)
    width = float(message["width"])
    if not (width > 0 and outline) and len(outline) < 3:
        raise ValueError("covers nothing")
    far = max(abs(value) for place in outline for value in place)
    if len(outline) > MOST_PLACES or not (far < 1e6 and 0 <= width < 1e5):
        raise ValueError("not an outline")
    named = str(message["photo"]), outline, width
    return MaskDrawn(seat_id, *named, bool(message["hides"]), bool(message["camera"]))


def decided_mask(gesture: MaskDrawn, block: Block) -> tuple[DrawMask, ...]:
    """The decision of a gesture: of a camera in film millimetres; none about a photo not there."""
    photo = block.photos.get(gesture.photo_id)
    if photo is None:
        return ()
    if not gesture.camera:
        return (DrawMask(gesture.photo_id, gesture.outline, gesture.width, gesture.hides),)
    film = photo.interior.film_from_pixel(np.array(gesture.outline)).tolist()
    outline = tuple((round(x, 4), round(y, 4)) for x, y in film)
    width = gesture.width * photo.interior.pixel_size_mm
    return (DrawMask(photo.camera, outline, width, gesture.hides, on_film=True),)


def mask_part(state: DeskState, base: Block, drawn: Drawn, recorded: Sequence[Recorded]) -> Part:
    """Every photo with what was drawn on it and what that took out of use; every stroke."""
    block = state.block
    masks = {name: photo.mask for name, photo in block.photos.items() if photo.mask}
    found, still = inside(base, masks), inside(block, masks)
    photos = [
        {
            "photo": name,
            "camera": photo.camera,
            "size": list(photo.size_px),
            "version": drawn[name].version if name in drawn else 1,
            "hidden": _rings(photo.mask.hidden),
            "freed": _rings(photo.mask.freed),
            "pixel_um": round(1000 * photo.interior.pixel_size_mm, 3),
            **_covered(name, found, still),
        }
        for name, photo in block.photos.items()
    ]
    strokes = [
        {
            "id": item.decision_id,
            "who": item.who,
            "when": item.when[:16],
            "subject": item.decision.subject,
            "camera": item.decision.on_film,
            "hides": item.decision.hides,
            "brush": item.decision.width > 0,
        }
        for item in reversed(standing(recorded))
        if isinstance(item.decision, DrawMask)
    ]
    ties = found.ties if masks else 0
    return {"photos": photos, "strokes": strokes, "ties": ties}


def _covered(photo_id: str, found: Inside, still: Inside) -> Part:
    """Names of control under a photo's mask: left out, and held by an operator."""
    held = {item.key for item in still.held if item.photo_id == photo_id}
    out = [i.point_id for i in found.control if i.photo_id == photo_id and i.key not in held]
    return {"out": sorted(out), "held": sorted(point for point, _ in held)}


def _rings(area: Area) -> list[list[list[list[float]]]]:
    """Polygons as rings of places, the outer one first."""
    return [
        [
            np.round(shapely.get_coordinates(ring), 1).tolist()
            for ring in (one.exterior, *one.interiors)
        ]
        for one in outlines(area)
    ]
