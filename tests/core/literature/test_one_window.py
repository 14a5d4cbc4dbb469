"""A template laid by hand or detected, sought in one window whose shift is known."""

import numpy as np
import pytest

from core.errors import ProjectError
from core.literature.common_grid import GridPair
from core.literature.detectors import detector_named, eight_bits, places_of
from core.literature.one_window import AT_POINTS, FROM_SCAN, SNAPPED, OperatorSearch, Sizes, Way
from tests.core.literature.test_operator_variants import SHIFT, SIDE, shifted_pair

SIZES = Sizes(20, 14)
NAMES = ("ncc", "ncc-high-pass", "gradient", "cfog", "fused", "sift", "orb", "surf")
WAYS: tuple[Way, ...] = ("hand", "d", "dd", "vd", "vdd", "k")


def misses(pair: GridPair, name: str, way: Way, at: tuple[float, float]) -> tuple[float, float]:
    """How far the best and the nearest of what was compared lie from the true place, pixels."""
    search = OperatorSearch(name, way, pair, SIZES)
    template = search.template_at(np.array([at]))
    assert template is not None
    if way not in SNAPPED:
        assert np.abs(template.place - at).max() <= 0.5
    # The window lies some pixels beside, as a georeference would put it.
    centre = template.place + np.array([3.0, 2.0])
    likeness = search.likeness(template, centre)
    assert np.abs(likeness.places - centre).max() <= SIZES.half + 1
    if likeness.surface is not None:
        assert likeness.surface.shape == (29, 29)
        assert likeness.surface.max() == pytest.approx(likeness.scores.max())
    true = template.place + (-SHIFT if way in FROM_SCAN else SHIFT)
    away = np.linalg.norm(likeness.places - true, axis=1)
    return float(away[np.argmax(likeness.scores)]), float(away.min())


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", NAMES)
def test_the_shift_is_found_wherever_it_can_be__truth(name: str, way: Way) -> None:
    """Of detected points none need lie at the true place; if one does, it is the most alike."""
    pair = shifted_pair()
    places = [(x + 0.3, y + 0.6) for x in (80, 118, 150) for y in (85, 121)]
    if (name, way) == ("surf", "vdd"):
        # It detects so few points that a chosen place has none near it.
        spots = places_of(detector_named(name).detect(eight_bits(pair.reference), None))
        places = [tuple(at) for at in spots if at.min() > 70 and at.max() < 170]
    told = [misses(pair, name, way, at) for at in places]
    right = [best <= 2.0 for best, nearest in told if nearest <= 1.0]
    assert len(right) >= (1 if way in AT_POINTS else 6)
    assert np.mean(right) >= (0.7 if way in AT_POINTS else 0.99)


def test_no_point_of_the_given_land_is_no_template__law() -> None:
    nowhere = np.zeros((SIDE, SIDE), bool)
    place = np.array([[120.0, 120.0]])
    assert OperatorSearch("ncc", "k", shifted_pair(), SIZES, nowhere).template_at(place) is None
    land = nowhere.copy()
    land[100:140, 140:180] = True
    template = OperatorSearch("ncc", "k", shifted_pair(), SIZES, land).template_at(place)
    assert template is not None
    column, row = np.floor(template.place[0]).astype(int)
    assert land[row, column]


@pytest.mark.parametrize("way", ["hand", "d"])
@pytest.mark.parametrize("name", ["sift", "orb", "surf"])
def test_a_distance_is_told_as_the_distance_it_is__law(name: str, way: Way) -> None:
    """From nought for the same descriptor to what two can differ at most; less is more alike."""
    pair = shifted_pair()
    search = OperatorSearch(name, way, pair, SIZES)
    template = search.template_at(np.array([[SIDE / 2, SIDE / 2]]))
    assert template is not None
    likeness = search.likeness(template, template.place)
    kind, times = search.measure
    told = times * likeness.scores
    assert kind == ("bits" if name == "orb" else "distance")
    # Half the sphere of descriptors without negative parts is the square root of two wide.
    assert 0 <= told.min() < told.max() <= (256 if name == "orb" else 2.0)
    assert told.argmin() == likeness.scores.argmax()
    if kind == "bits":
        assert np.allclose(told, np.round(told), atol=1e-3)


def test_an_unknown_detector_is_no_orb__law() -> None:
    with pytest.raises(ProjectError, match=r"brisk: is no detector\. Take sift, orb or surf\."):
        detector_named("brisk")
