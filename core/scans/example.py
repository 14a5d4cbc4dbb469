"""Marks like one that an operator showed: of any shape, at the places typical for cameras.

A click gives the middle of the mark only. Its size is found by trial: of several sizes, the set
search takes the one that it finds again best. The picture beside the mark differs from copy to
copy, so the mean of the found copies shows the mark alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.geometry.camera import Camera
from core.geometry.robust import TINY
from core.raster.scan_file import ScanFile, read_window
from core.scans.centring import Centre, Gray, Weights, centre_by_symmetry, disc, sample_about
from core.scans.corners import FARTHEST_MM, FINE_MM, Edges, edges_about
from core.scans.film_area import FilmArea
from core.scans.marks import EXAMPLE, SURROUND, Mark, Picture, draw_mark
from core.scans.naming import (
    ASIDE,
    CORNERS,
    SIDES,
    WAYS,
    Layout,
    OpenLayout,
    certified_layouts,
    lying,
)

Corner = tuple[tuple[float, float], Edges]
"""Where two edges meet, column and row, and how they run."""
RADII_MM = (0.5, 0.8, 1.3, 2.1)  # design: marks of the library, in steps of about 1.6
"""How far a mark may reach from its middle: all are tried."""
POINTED_MM = 0.25  # design: two pixels of a coarse scan: as near as one points on a screen
"""How far the middle of a symmetric mark may lie from where somebody pointed."""
SYMMETRIC_FROM = 0.8  # design: half way between notches (0.3 to 0.6) and worn crosses (0.9)
"""Likeness to itself after half a turn from which a mark is symmetric about its middle."""
INSET_OFF_MM = 4.0  # design: how well the border of old pictures tells the middle of the film
"""How much nearer to the border than the mark that was shown the others may lie."""
EXAMPLE_MM = 0.03  # design: as `FITTING_MM`: what is shown is wider than the thinnest drawn lines
"""Pixel to which finer scans are reduced where an example is cut and its copies are measured."""
DIAGONAL = 1.5  # design: more than the root of two: a turned window stays inside
"""Half width of a picture in that of the template cut from it."""


@dataclass(frozen=True, slots=True)
class ShownMark:
    """One mark of a camera that somebody pointed at."""

    scan: ScanFile
    """The scan that shows it."""
    place: tuple[float, float]
    """Column and row of its middle."""
    outward: tuple[float, float]
    """Direction from the middle of the photo, in the film's axes (right, down)."""
    pixel_mm: float
    """Size of a scan pixel, millimetres."""
    film_mm: tuple[float, float]
    """About where it lies from the middle of the picture, x right and y up, millimetres."""


def marks_like(shown: ShownMark, corner: Callable[[], Corner | None]) -> tuple[Mark, ...]:
    """The mark that was shown, in every size it may have.

    Args:
        shown: The mark.
        corner: Tells where its edges meet, as `shown_edges`; asked where it is no figure.

    Raises:
        ScanError: The scan cannot be read.
    """
    return tuple(_pictured(shown, radius, corner) for radius in RADII_MM)


def _pictured(shown: ShownMark, radius_mm: float, corner: Callable[[], Corner | None]) -> Mark:
    """The mark with one reach, its middle on the point of symmetry where it has one."""
    window, first, start, by = _window_about(shown, radius_mm)

    def within() -> Corner | None:
        met = corner()
        if met is None:
            return None
        return ((met[0][0] - first[0]) / by, (met[0][1] - first[1]) / by), met[1]

    return _centred(window, start, shown.outward, radius_mm, shown.pixel_mm * by, within)


def _window_about(
    shown: ShownMark, radius_mm: float
) -> tuple[Gray, tuple[int, int], tuple[float, float], int]:
    """Grays about a shown mark, their first column and row, its place in them, their reduction."""
    by = example_reduction(shown.pixel_mm)
    reach = _window_px(radius_mm, shown.pixel_mm * by) * by
    corner = round(shown.place[0]) - reach, round(shown.place[1]) - reach
    window = read_window(shown.scan, *corner, 2 * reach, 2 * reach, by, outside="edge")
    start = (shown.place[0] - corner[0]) / by, (shown.place[1] - corner[1]) / by
    return window, corner, start, by


def shown_edges(shown: ShownMark) -> Corner | None:
    """Where the edges of a shown mark meet, scan pixels, and how they run; None for a figure."""
    window, corner, start, by = _window_about(shown, RADII_MM[0])
    cell_mm = shown.pixel_mm * by
    found = edges_about(window, start, POINTED_MM / cell_mm + 1, cell_mm)
    if found is None:
        return None
    return (corner[0] + by * found[0].column, corner[1] + by * found[0].row), found[1]


def example_reduction(pixel_mm: float) -> int:
    """Scan pixels a side that become one where an example is looked at closely."""
    return max(1, round(EXAMPLE_MM / pixel_mm))


def mean_picture(
    mark: Mark,
    copies: Sequence[tuple[Gray, tuple[float, float], Mark]],
    turn: float,
    pixel_mm: float,
) -> Mark:
    """The mark as its copies show it together; what is only beside one of them is gone.

    Args:
        mark: The mark that they were found with.
        copies: Window, middle in it (column, row), and the mark as it lies there, of each.
        turn: Rotation of the film in the scan, radians, clockwise as seen.
        pixel_mm: Size of a pixel of the windows.
    """
    assert mark.picture is not None, "only examples are learnt"
    half = _window_px(mark.radius_mm, pixel_mm)
    laid: list[Weights] = []
    for window, place, seen in copies:
        patch = sample_about(window, np.array(place), 2 * half + 1)
        outward = mark.picture.outward if seen.lies == "same" else seen.outward
        there = Picture(patch, pixel_mm, _turned(outward, turn), mark.picture.symmetric)
        lies = "mirrored" if seen.lies == "mirrored" else "turned"
        back = replace(mark, picture=there, outward=mark.picture.outward, lies=lies)
        upright = draw_mark(back, pixel_mm, surround=half * pixel_mm / mark.radius_mm)
        laid.append((upright - upright.mean()) / max(float(upright.std()), TINY))
    middle = np.median(laid, axis=0).astype(np.float32)
    about = (middle.shape[1] / 2, middle.shape[0] / 2)

    def corner() -> Corner | None:
        met = edges_about(middle, about, POINTED_MM / pixel_mm + 1, pixel_mm)
        return None if met is None else ((met[0].column, met[0].row), met[1])

    return _centred(middle, about, mark.picture.outward, mark.radius_mm, pixel_mm, corner)


def _turned(outward: tuple[float, float], turn: float) -> tuple[float, float]:
    """A direction turned clockwise as seen (column towards row)."""
    cosine, sine = float(np.cos(turn)), float(np.sin(turn))
    return outward[0] * cosine - outward[1] * sine, outward[0] * sine + outward[1] * cosine


def _half_px(radius_mm: float, pixel_mm: float) -> int:
    """Half width of a picture from which a turned template can be cut, pixels."""
    return int(np.ceil(radius_mm * SURROUND * DIAGONAL / pixel_mm)) + 1


def _window_px(radius_mm: float, pixel_mm: float) -> int:
    """Half width of a window from which a picture is cut, its middle yet to be found."""
    wide = max(_half_px(radius_mm, pixel_mm), int(np.ceil(FARTHEST_MM / pixel_mm)))
    return wide + int(np.ceil(POINTED_MM / pixel_mm)) + 4


def _centred(
    window: Gray,
    start: tuple[float, float],
    outward: tuple[float, float],
    radius_mm: float,
    pixel_mm: float,
    corner: Callable[[], Corner | None],
) -> Mark:
    """The mark about a place of a window, on its point of symmetry where it has one."""
    about = centre_by_symmetry(window, start, POINTED_MM / pixel_mm + 1, disc(radius_mm / pixel_mm))
    symmetric = isinstance(about, Centre) and about.correlation > SYMMETRIC_FROM
    middle, edges = start, None
    if isinstance(about, Centre) and symmetric:
        middle = about.column, about.row
    elif pixel_mm <= FINE_MM:
        middle, edges = corner() or (start, None)
    gray = sample_about(window, np.array(middle), 2 * _half_px(radius_mm, pixel_mm) + 1)
    picture = Picture(gray, pixel_mm, outward, symmetric, edges)
    return Mark(EXAMPLE, radius_mm, 0.0, picture=picture)


def layout_like(
    camera: Camera, shown: ShownMark, area: FilmArea, quarters: Sequence[int]
) -> Layout | OpenLayout:
    """Where copies of a mark may lie: those of its group in the certificate, or opposite to it.

    Args:
        camera: The camera; its marks may be unknown.
        shown: The mark.
        area: The picture in its scan.
        quarters: Quarter turns that the frame's shape allows.
    """
    film = np.array(shown.film_mm)
    if camera.fiducials_mm:
        layouts = certified_layouts(camera, quarters)
        return min(layouts, key=lambda one: _nearest_mm(one, film))
    half, away = np.array(camera.frame_mm) / 2, np.abs(film)
    corner = bool((away > ASIDE * half).all())
    # Where the border was not seen on all sides one of both distances may be far off.
    hints = [float((away - half).mean())] if corner else [float((away - half).max())]
    if corner and len(area.seen) < len(SIDES):
        hints += (away - half).tolist()
    places = CORNERS if corner else SIDES
    return OpenLayout(
        tuple(places),
        np.array(list(places.values())),
        half + min(hints) - INSET_OFF_MM,
        half + max(hints) + INSET_OFF_MM,
        half,
    )


def _nearest_mm(layout: Layout, film: np.ndarray) -> float:
    """How far a place lies from the nearest mark of a layout, however the film lies."""
    return min(float(np.linalg.norm(lying(layout.film, way) - film, axis=1).min()) for way in WAYS)
