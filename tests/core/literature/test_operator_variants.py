"""Every variant of the thesis's Table 2 on a pair whose shift is known."""

import cv2
import numpy as np
import pytest

from core.literature.common_grid import GridPair
from core.literature.detectors import detector_named, eight_bits, places_of
from core.literature.one_window import Sizes
from core.literature.operator_variants import paired
from core.raster.grid import Grid

SIDE, SHIFT = 240, np.array([4, -3])
SIZES = Sizes(12, 10)


@pytest.fixture(scope="module")
def shifted() -> GridPair:
    return shifted_pair()


def shifted_pair() -> GridPair:
    """A scan that shows the ortho four columns to the right and three rows up, with grain."""
    rng = np.random.default_rng(3)
    ground = cv2.GaussianBlur(rng.normal(0, 1, (SIDE + 40, SIDE + 40)), (0, 0), 2.0)
    ground = (128 + 60 * ground / ground.std()).astype(np.float32)
    ortho = ground[20 : 20 + SIDE, 20 : 20 + SIDE]
    scan = ground[20 - SHIFT[1] : 20 - SHIFT[1] + SIDE, 20 - SHIFT[0] : 20 - SHIFT[0] + SIDE]
    grain = rng.normal(0, 3, scan.shape).astype(np.float32)
    grid = Grid(0.0, float(SIDE), 1.0, SIDE, SIDE)
    seen, nowhere = np.ones((SIDE, SIDE), bool), np.zeros((SIDE, SIDE, 2))
    return GridPair(grid, scan + grain, np.ascontiguousarray(ortho), seen, nowhere)


@pytest.mark.parametrize(
    ("variant", "within", "least"),
    [
        # Dense ways look at every place: the right one is among them.
        ("sift-vd", 2, 0.95), ("orb-vd", 2, 0.95), ("ncc-vd", 2, 0.95), ("cfog-vd", 2, 0.95),
        ("sift-d", 2, 0.9),
        # A detector must find the same point again.
        ("sift-dd", 2, 0.7), ("orb-dd", 2, 0.7),
        # It knows nothing of junctions: the nearest point it detects lies some pixels beside.
        ("sift-vdd", 5, 0.7), ("orb-vdd", 5, 0.7),
        # Points that SIFT detects, each sought at every place.
        ("ncc-k", 2, 0.95),
        ("surf-dd", 2, 0.7), ("surf-d", 2, 0.9),
    ],
)  # fmt: skip
def test_a_shift_is_found_by_every_variant__truth(
    shifted: GridPair, variant: str, within: float, least: float
) -> None:
    line = np.arange(40, SIDE - 40, 20) + 0.5
    junctions = np.stack(np.meshgrid(line, line), axis=2).reshape(-1, 2)
    pairs = paired(variant, shifted, junctions, SIZES)
    assert len(pairs) >= 20
    off = np.linalg.norm(pairs[:, 0] - pairs[:, 1] - SHIFT, axis=1)
    assert np.mean(off <= within) >= least
    # Nothing is sought outside the window.
    assert np.abs(pairs[:, 0] - pairs[:, 1]).max() <= SIZES.half + 1


def test_surf_finds_what_it_detected_in_the_ortho_again__truth(shifted: GridPair) -> None:
    """It detects a fifth of what SIFT does: a chosen place has no point of the scan near it."""
    spots = places_of(detector_named("surf").detect(eight_bits(shifted.reference), None))
    inside = ((spots > 40) & (spots < SIDE - 40)).all(axis=1)
    pairs = paired("surf-vdd", shifted, spots[inside], SIZES)
    off = np.linalg.norm(pairs[:, 0] - pairs[:, 1] - SHIFT, axis=1)
    # By chance 13 of 441 places.
    assert np.mean(off <= 2) > 0.5


def test_nothing_is_detected_outside_the_given_land__law(shifted: GridPair) -> None:
    land = np.zeros((SIDE, SIDE), bool)
    land[60:180, 70:150] = True
    line = np.arange(40, SIDE - 40, 20) + 0.5
    junctions = np.stack(np.meshgrid(line, line), axis=2).reshape(-1, 2)
    sides = {"sift-d": 0, "sift-dd": 0, "ncc-k": 1, "sift-vdd": 0, "orb-vdd": 0, "surf-vdd": 0}
    for variant, side in sides.items():
        pairs = paired(variant, shifted, junctions, SIZES, land)
        everywhere = paired(variant, shifted, junctions, SIZES)
        assert 0 < len(pairs) < len(everywhere)
        columns, rows = pairs[:, side].astype(int).T
        assert land[rows, columns].all()
        assert not len(paired(variant, shifted, junctions, SIZES, np.zeros_like(land)))
