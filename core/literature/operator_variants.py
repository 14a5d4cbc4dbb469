"""Points of scan and ortho paired by an operator, in each way of the thesis's Table 2.

Scan and ortho lie on one grid, and a pair is two places of it.
"""

from typing import Any, cast

import cv2
import numpy as np
from jaxtyping import Float64

from core.arrays import Mask
from core.literature.common_grid import GridPair, Places
from core.literature.one_window import FROM_SCAN, SNAPPED, OperatorSearch, Sizes, Way

# design: as many as a photo has junctions, spread over all of it.
DETECTED = 150
"""So many of the strongest points detected in a picture are sought in the other."""
Pairs = Float64[np.ndarray, "n 2 2"]
"""For each pair its place in the scan, then that in the ortho, grid points."""


def paired(
    variant: str, pair: GridPair, junctions: Places, sizes: Sizes, within: Mask | None = None
) -> Pairs:
    """Pairs of one variant, one for each point that has any.

    Args:
        variant: Operator and way, such as `sift-vdd`; `ncc-vd` correlates.
        pair: Scan and ortho.
        junctions: The junctions on the grid, all of them far enough from the rim.
        sizes: Patch and search.
        within: Where points may be detected, such as built-up land; everywhere without it.
    """
    name, way = cast("tuple[str, Way]", variant.split("-"))
    search = OperatorSearch(name, way, pair, sizes, within)
    if way in SNAPPED:
        templates = search.templates_of(_strongest(search))
    else:
        templates = search.templates_at(junctions)
    found: list[np.ndarray] = []
    for template in templates:
        best = search.likeness(template, template.place).best
        if len(best):
            found.append(np.vstack([template.place, best]))
    pairs = np.array(found).reshape(-1, 2, 2)
    return pairs if way in FROM_SCAN else pairs[:, ::-1]


def _strongest(search: OperatorSearch) -> list[Any]:
    """The strongest points of what is seen, far from its rim, the best one of each place."""
    reach, within = search.sizes.inner + search.sizes.half, search.within
    inside = cv2.erode(
        search.pair.seen.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=reach
    )
    inside[:reach], inside[-reach:], inside[:, :reach], inside[:, -reach:] = 0, 0, 0, 0
    if within is not None:
        inside[~within] = 0
    points = sorted(search.detecting.detect(search.own, inside), key=lambda point: -point.response)
    kept: dict[tuple[int, int], Any] = {}
    for point in points:
        kept.setdefault((int(point.pt[0]) // reach, int(point.pt[1]) // reach), point)
    return list(kept.values())[:DETECTED]
