"""Georeferenced and final positions of the photos, as values for a map."""

from collections.abc import Iterable
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np

from core.block import Photo, ground_of
from core.doubts import Doubt
from core.geometry.camera import Camera
from core.quality.residuals import displacement
from ui.review.state import DeskState, InitialState

Part = dict[str, Any]
NOWHERE = ("area",)
"""Sources that say nothing of where a photo lies."""


def placement_part(state: DeskState, initial: InitialState, doubts: Iterable[Doubt]) -> Part:
    """Footprints by the given georeference and as placed, furthest first, and what has no place.

    Args:
        state: The block with its newest adjustment.
        initial: What the photos began from.
        doubts: What the engine was unsure of.
    """
    oriented = state.oriented
    messages = _by_photo(doubts)
    photos = [
        _photo(
            replace(photo, approximate=initial.exterior.get(name, photo.approximate)),
            oriented.camera_of(name),
            initial.sources.get(name, ""),
            messages,
        )
        for name, photo in oriented.photos.items()
    ]
    photos.sort(key=lambda row: (row["oriented"], -(row["rms"] or 0.0)))
    off = [row["rms"] for row in photos if row["rms"] is not None]
    return {
        "photos": photos,
        "set_aside": [[name, why] for name, why in sorted(initial.set_aside.items())],
        "median": round(median(off), 1) if off else None,
        "worst": max(off, default=None),
    }


def _photo(photo: Photo, camera: Camera, source: str, messages: dict[str, list[str]]) -> Part:
    """One photo with both outlines, metres east and north, and by how much they differ."""
    off = displacement(photo, camera)
    given = source not in NOWHERE
    believed = replace(photo, exterior=photo.approximate)
    placed = photo.oriented
    return {
        "photo": photo.photo_id,
        "oriented": placed,
        "source": source,
        "before": _ring(believed, camera) if given else None,
        "after": _ring(photo, camera) if placed else None,
        "shift": [round(float(value), 1) for value in off.shift_m] if placed and given else None,
        "turn": round(float(np.degrees(off.turn)), 2) if placed and given else None,
        "scale": round(off.scale, 4) if placed and given else None,
        "rms": round(off.rms_m, 1) if placed and given else None,
        "why": [] if placed else messages.get(photo.photo_id, []),
    }


def _ring(photo: Photo, camera: Camera) -> list[list[float]] | None:
    """Corners of the picture area on the ground at its mean height."""
    pixels = photo.interior.pixel_from_film(camera.frame_corners_mm)
    ground = ground_of(photo, camera, pixels)[:, :2]
    return np.round(ground, 1).tolist() if np.isfinite(ground).all() else None


def _by_photo(doubts: Iterable[Doubt]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for doubt in doubts:
        found.setdefault(doubt.subject, []).append(doubt.message)
    return found
