"""Tones and seams of a mosaic, from its orthos in small."""

from collections.abc import Mapping, Sequence

import numpy as np

from core.mosaic.overview import (
    Overview,
    SeamView,
    read_band_overviews,
    read_overview,
    seam_view,
)
from core.mosaic.radiometry import Balance, FilmPlane
from core.mosaic.seam_cut import LabelledGround, SeamGuides, label_ground
from core.mosaic.seams import Area, EditedSeams, Seam, fill_gaps, only_polygons, outline_seams
from core.mosaic.tones import balance_bands, toned_as_photo, toned_as_reference
from core.orthos.rectification import OrthoProduct
from core.progress import Progress
from core.raster.grid import Grid
from core.raster.ortho import Ortho

# design: METHODS 8 gives 2 to 10; it hides a step of gray and is narrower than a road
FEATHER_PX = 8
"""Width over which one photo fades into the next, pixels."""
# design: clear of the rim, where the mask is known to a cell of some metres
KEEP_INSIDE_M = 10.0
"""A seam keeps this distance from the edge of a photo's picture where another photo shows the
place as well, metres: room to feather."""
# design: less than half of what seams keep from buildings
CELL_M = 2.0
"""Side of the cells that seams are drawn in, metres, in whole pixels."""
# design: two pixels, so that grain is averaged
LEAST_CELL_PX = 2
# design: a gigabyte and a half of overviews
MOST_CELLS = 100_000_000
"""Cells of all photos together; where there are more, they are larger."""
# design: outlines of neighbours are smoothed together, that of a whole photo alone
SMOOTHED_CELLS = 1.0
"""A seam at the edge of a photo may lie so far outside what the photo shows, cells."""
# design: ten thousand cells for four unknowns of a photo, and grain is averaged away
BALANCE_CELLS = 128
"""Cells along the longest side of an ortho from which the balance is estimated."""


def cell_px(orthos: Sequence[OrthoProduct]) -> int:
    """Pixels a side of the cells that seams are drawn in."""
    gsd = orthos[0].grid.ground_sample_distance_m
    pixels = sum(ortho.grid.columns * ortho.grid.rows for ortho in orthos)
    least = int(np.ceil(np.sqrt(pixels / MOST_CELLS)))
    return max(LEAST_CELL_PX, least, round(CELL_M / gsd))


def read_overviews(
    orthos: Sequence[OrthoProduct], grid: Grid, full_scale: float, progress: Progress
) -> list[Overview]:
    """The orthos in small, with gray values up to one full scale."""
    side, overviews = cell_px(orthos), list[Overview]()
    for done, ortho in enumerate(orthos):
        _assert_aligned(ortho.grid, grid)
        overviews.append(read_overview(ortho, side, full_scale))
        progress.report(float(done + 1), float(len(orthos)), "seams and balance")
    return overviews


def shown_ground(overviews: Sequence[Overview]) -> dict[str, Area]:
    """The ground that each photo shows, to two cells, in the block's CRS; small holes closed."""
    areas: dict[str, Area] = {}
    for view in overviews:
        labels = np.where(view.shown, 0, -1).astype(np.int16)
        reach = SMOOTHED_CELLS * view.grid.ground_sample_distance_m
        for seam in outline_seams(LabelledGround(view.grid, labels), [view.photo_id]):
            areas[view.photo_id] = only_polygons(seam.area.buffer(reach, join_style="mitre"))
    return areas


def balanced(
    orthos: Sequence[OrthoProduct],
    overviews: Sequence[Overview],
    planes: Mapping[str, FilmPlane] | None,
    full_scale: float,
    like: Ortho | str | None,
    bands: int,
) -> Mapping[str, Balance]:
    """The balance of every photo, and of each of so many bands.

    `like` is what they are given the tone of: the reference, a photo, their mean where it is empty;
    None leaves tones untouched.
    """
    if like is None:
        return {ortho.photo_id: Balance() for ortho in orthos}
    longest = max(max(view.grid.columns, view.grid.rows) for view in overviews)
    factor = max(1, longest // BALANCE_CELLS)
    views = [[view.coarser(factor) for view in overviews]]
    if bands > 1:
        side = cell_px(orthos) * factor
        read = [read_band_overviews(ortho, side, full_scale) for ortho in orthos]
        # A gray photo among colours shows the same in each.
        views = [[one[min(band, len(one) - 1)] for one in read] for band in range(bands)]
    found = balance_bands(views, full_scale, planes)
    if isinstance(like, Ortho):
        return toned_as_reference(found, views, like, full_scale)
    return toned_as_photo(found, like) if like else found


def lay_seams(
    overviews: Sequence[Overview],
    balances: Mapping[str, Balance],
    full_scale: float,
    shown: Mapping[str, Area],
    *,
    edited: EditedSeams | None,
    dates: Mapping[str, str] | None,
    guides: SeamGuides | None,
    by_nadir: bool,
    progress: Progress,
) -> tuple[tuple[Seam, ...], tuple[str, ...]]:
    """Seams over all that the photos show, and what was done to edited ones.

    Args:
        overviews: The orthos in small.
        balances: Their tones.
        full_scale: Largest gray value.
        shown: The ground that each photo shows.
        edited: Seams of the user's; only what they leave open, or give to a photo that does not
            show it, is laid.
        dates: Date of each photo.
        guides: Buildings and roads.
        by_nadir: Lay seams midway between nadirs.
        progress: Told per pair of photos.
    """
    views = _views(overviews, balances, full_scale)
    midway = by_nadir or edited is not None
    ground = label_ground(views, guides or SeamGuides(), by_nadir=midway, progress=progress)
    drawn = outline_seams(ground, [view.photo_id for view in views], dates)
    if edited is None:
        return drawn, ()
    filled = fill_gaps(edited, drawn, shown)
    return filled.seams, filled.notes


def _views(
    overviews: Sequence[Overview],
    balances: Mapping[str, Balance],
    full_scale: float,
) -> list[SeamView]:
    """The photos as seams are sought in them, balanced, in gray values of 255."""
    cell_m = overviews[0].grid.ground_sample_distance_m
    # A cell has two pixels at least.
    keep_m = max(KEEP_INSIDE_M, FEATHER_PX / LEAST_CELL_PX * cell_m)
    views: list[SeamView] = []
    for view in overviews:
        balance = balances[view.photo_id].luminance
        gray = balance.corrected(np.nan_to_num(view.values), view.grid)
        views.append(seam_view(view, gray * np.float32(255 / full_scale), keep_m))
    return views


def _assert_aligned(part: Grid, whole: Grid) -> None:
    # design: rounding of metres
    assert abs(part.ground_sample_distance_m - whole.ground_sample_distance_m) < 1e-9
    corner = whole.grid_from_object(np.array([[part.west, part.north]]))
    # design: a thousandth of a pixel is not seen
    assert np.abs(corner - np.rint(corner)).max() < 1e-3, "orthos must share the mosaic's pixels"
