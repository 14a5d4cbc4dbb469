"""How the films have changed their shape: vectors of their marks, shrinkage and shear."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from core.arrays import FilmPoints
from core.block import Photo
from core.geometry.camera import Camera
from core.geometry.interior import film_shape
from core.geometry.transforms import PlaneTransform, fit_similarity
from ui.review.initial_state import InitialState
from ui.review.state import DeskState

Part = dict[str, Any]
LEAST_FILMS = 2
"""Films of a camera from which there is a mean over the roll."""


def films_part(state: DeskState, initial: InitialState) -> Part:
    """Vectors and figures of every film, and of every camera the mean over its roll."""
    block = state.block
    films = [
        _film(photo, block.camera_of(name), initial.pixel_mm.get(name))
        for name, photo in block.photos.items()
        if photo.interior.names
    ]
    cameras = dict.fromkeys(film["camera"] for film in films)
    return {
        "films": films,
        "rolls": {name: _roll([f for f in films if f["camera"] == name]) for name in cameras},
        "frames": {name: list(block.cameras[name].frame_mm) for name in cameras},
    }


def _film(photo: Photo, camera: Camera, pixel_mm: float | None) -> Part:
    """One film; without the scanner's nominal pixel its own mean one tells shape alone."""
    interior = photo.interior
    shape = film_shape(interior, pixel_mm or interior.pixel_size_mm)
    film = interior.film_from_pixel(interior.pixels) - interior.residuals_um / 1000
    plain = _after_similarity(photo, film)
    marks = [
        [name, *_rounded(place, 3), *_rounded(left, 2), *_rounded(before, 2)]
        for name, place, left, before in zip(
            interior.names, film, interior.residuals_um, plain, strict=True
        )
    ]
    return {
        "photo": photo.photo_id,
        "camera": photo.camera,
        "model": interior.model,
        "marks": marks,
        "scale_x": round(1e6 * (shape.scale_x - 1), 1),
        "scale_y": round(1e6 * (shape.scale_y - 1), 1),
        "shear": round(shape.shear_mrad, 4),
        "rms": round(interior.rms_um, 2),
        "rms_plain": round(float(np.sqrt(np.mean(plain**2))), 2),
        "redundancy": interior.redundancy,
        "chance": round(interior.chance, 4) if interior.redundancy else None,
    }


def _after_similarity(photo: Photo, film: FilmPoints) -> FilmPoints:
    """What shift, turn and one scale leave of the marks, micrometres: the film's own shape."""
    interior = photo.interior
    fit = fit_similarity(interior.pixels, film, mirrored=not interior.mirrored)
    if not isinstance(fit, PlaneTransform):
        return np.zeros_like(film)
    return 1000 * fit.residuals


def _roll(films: Sequence[Part]) -> Part | None:
    """Mean and spread over all films of a camera; None for a single one."""
    if len(films) < LEAST_FILMS:
        return None
    by_mark: dict[str, list[list[float]]] = {}
    for film in films:
        for name, *values in film["marks"]:
            by_mark.setdefault(name, []).append(values)
    marks = [
        [name, *_rounded(np.mean(np.array(rows), axis=0), 2), len(rows)]
        for name, rows in by_mark.items()
    ]
    figures = np.array([[f["scale_x"], f["scale_y"], f["shear"]] for f in films])
    return {
        "count": len(films),
        "marks": marks,
        "mean": _rounded(figures.mean(axis=0), 4),
        "spread": _rounded(figures.std(axis=0, ddof=1), 4),
        "rms": round(float(np.sqrt(np.mean([film["rms"] ** 2 for film in films]))), 2),
    }


def _rounded(values: Any, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
