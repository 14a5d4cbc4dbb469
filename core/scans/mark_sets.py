"""Corner marks and marks of the sides together: each group is of one kind, all lie on one film."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.raster.scan_file import ScanFile
from core.scans.constellation import Constellation, ConstellationOptions, find_constellation
from core.scans.film_area import FilmArea
from core.scans.layouts import Layout


def find_mark_sets(
    scan: ScanFile,
    layouts: Sequence[Layout],
    pixel_mm: float,
    area: FilmArea,
    agree_mm: float,
    options: ConstellationOptions,
) -> list[Constellation]:
    """One set for each layout, all agreeing: where two disagree the better one places the other.

    A layout nothing of which was seen comes with the places the best set gives its marks, and no
    names. Without any set there is none.

    Args:
        scan: The scan.
        layouts: Patterns in which marks lie, each of one kind.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        agree_mm: How far sets may disagree about each other's places, millimetres.
        options: How they are looked for.
    """
    sets = [find_constellation(scan, [one], pixel_mm, area, options) for one in layouts]
    found = [one for one in sets if isinstance(one, Constellation)]
    if len(layouts) < 2 or not found:
        return found
    found.sort(key=lambda one: one.score * one.symmetry, reverse=True)
    best = found[0]
    others = [one for one in layouts if one is not best.layout]
    result = [best]
    for layout in others:
        narrow = replace(layout, ways=(best.way,))
        placed = _placed_by(best, area, pixel_mm)
        search = replace(options, reach_seen_mm=agree_mm + 3.0)
        again = find_constellation(scan, [narrow], pixel_mm, placed, search)
        if isinstance(again, Constellation) and _agree(best, again, pixel_mm, agree_mm):
            result.append(again)
        else:
            result.append(_unseen(best, narrow))
    return result


def _placed_by(found: Constellation, area: FilmArea, pixel_mm: float) -> FilmArea:
    """The picture area moved and turned so that a found set lies in it as its layout says."""
    film = found.layout.lying(found.way)
    at = {name: i for i, name in enumerate(found.layout.names)}
    fit = fit_similarity(film[[at[n] for n in found.names]], found.pixels, mirrored=True)
    if not isinstance(fit, PlaneTransform):
        return area
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    half = np.ptp(area.corners, axis=0) * pixel_mm / 2
    return FilmArea(apply_affine(fit.matrix, corners * half), ("left", "right", "top"), area.scores)


def _unseen(best: Constellation, layout: Layout) -> Constellation:
    """A layout none of whose marks was seen, placed by the best set."""
    at = {name: i for i, name in enumerate(best.layout.names)}
    film = best.layout.lying(best.way)[[at[name] for name in best.names]]
    fit = fit_similarity(film, best.pixels, mirrored=True)
    assert isinstance(fit, PlaneTransform)
    put = apply_affine(fit.matrix, layout.lying(best.way)).tolist()
    places = {name: (column, row) for name, (column, row) in zip(layout.names, put, strict=True)}
    return replace(
        best, names=(), pixels=np.zeros((0, 2)), correlations=np.zeros(0), predicted=places,
        layout=layout,
    )  # fmt: skip


def _agree(first: Constellation, second: Constellation, pixel_mm: float, agree_mm: float) -> bool:
    """True when a similarity through the first set puts the second where it was found."""
    at = {name: i for i, name in enumerate(first.layout.names)}
    film = first.layout.lying(first.way)[[at[n] for n in first.names]]
    fit = fit_similarity(film, first.pixels, mirrored=True)
    if not isinstance(fit, PlaneTransform):
        return False
    at = {name: i for i, name in enumerate(second.layout.names)}
    put = apply_affine(fit.matrix, second.layout.lying(first.way)[[at[n] for n in second.names]])
    apart = np.linalg.norm(put - second.pixels, axis=1)
    return bool(np.median(apart) * pixel_mm < agree_mm)


def middles_apart_mm(sets: Sequence[Constellation], pixel_mm: float) -> float:
    """Distance between the middles of two sets of four."""
    middles = [np.mean(list(one.predicted.values()), axis=0) for one in sets]
    return float(np.linalg.norm(middles[0] - middles[1])) * pixel_mm
