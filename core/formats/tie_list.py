"""Tie points as a table with one ray per row, kept with blocks of other programs."""

from collections.abc import Container
from pathlib import Path

import numpy as np

from core.formats.exchange import ExchangeTies
from core.formats.records import read_rows, write_rows

HEAD = ("point", "scan", "column", "row", "sigma_px")
"""Columns; pixels count from the outer corner of the first pixel, the last may be empty."""
USUAL_SIGMA_PX = 0.5  # design: what feature matching leaves; variance components tell more.
"""Standard deviation per axis of a ray whose program says none."""


def write_ties(path: Path, ties: ExchangeTies) -> None:
    """Write every ray, numbers with all their digits."""
    sigmas = [""] * len(ties.point) if ties.sigma_px is None else ties.sigma_px.tolist()
    rays = zip(ties.point, ties.photo, ties.pixels.tolist(), sigmas, strict=True)
    rows = [
        (ties.names[point] if ties.names else point, ties.photo_ids[photo], *pixel, sigma)
        for point, photo, pixel, sigma in rays
    ]
    write_rows(path, [HEAD, *rows])


def read_ties(path: Path, photos: Container[str]) -> ExchangeTies:
    """Rays in the photos that are there, of points that two of them see.

    Raises:
        ProjectError: It cannot be read, lacks a column, or a number in it is none.
    """
    rays: dict[str, dict[str, tuple[float, float, float]]] = {}
    for row in read_rows(path, HEAD[:4]):
        photo = row.filled("scan")
        if photo in photos:
            sigma = row.number_in("sigma_px") if row.cell("sigma_px") else USUAL_SIGMA_PX
            own = rays.setdefault(row.filled("point"), {})
            row.refuse_again(photo, own)
            own[photo] = (row.number_in("column"), row.number_in("row"), sigma)
    kept = {point: own for point, own in rays.items() if len(own) > 1}
    names = tuple(dict.fromkeys(photo for own in kept.values() for photo in own))
    index = {name: number for number, name in enumerate(names)}
    values = np.array([ray for own in kept.values() for ray in own.values()]).reshape(-1, 3)
    return ExchangeTies(
        names,
        np.repeat(np.arange(len(kept)), [len(own) for own in kept.values()]),
        np.array([index[photo] for own in kept.values() for photo in own], dtype=np.int64),
        values[:, :2],
        tuple(kept),
        sigma_px=values[:, 2],
    )
