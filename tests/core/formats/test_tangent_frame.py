"""The tangent frame, against the Earth's curve and pyproj's geocentric coordinates."""

import numpy as np
import pytest
from pyproj import Transformer

from core.errors import CrsError
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangePhoto,
    ExchangePoint,
    ExchangeTies,
    pixels_of,
)
from core.formats.tangent_frame import in_tangent_frame
from core.geometry.exterior import ExteriorOrientation
from core.geometry.map_in_space import tangent_frame

MIDDLE = np.array([-743000.0, -1043000.0, 250.0])
EARTH = 6_371_000.0


def block_over(crs: str, middle: np.ndarray) -> ExchangeBlock:
    """Two photos 3000 m above level ground, forty kilometres apart."""
    camera = ExchangeCamera("c", (-0.02,), size_px=(12000, 12000))
    affine = np.array([[8000.0, 0.0, 6000.0], [0.0, -8000.0, 6000.0]])
    photos, points = {}, {}
    for name, east in (("a", -20000.0), ("b", 20000.0)):
        centre = middle + np.array([east, 1000.0, 3000.0])
        photos[name] = ExchangePhoto(
            name, f"{name}.tif", "c", affine, ExteriorOrientation(centre, 0.02, -0.03, 1.0),
            (0.1, 0.2, 0.3), (1e-5, 2e-5, 3e-5),
        )  # fmt: skip
        for n, (e, h) in enumerate([(-1500.0, 900.0), (1200.0, -1600.0), (100.0, 60.0)]):
            place = (float(centre[0] + e), float(centre[1] + h), float(middle[2]))
            points[f"{name}{n}"] = ExchangePoint(f"{name}{n}", place, (0.1, 0.1, 0.2))
    return ExchangeBlock(crs, {"c": camera}, photos, points)


@pytest.mark.parametrize(
    ("crs", "middle"),
    [
        ("EPSG:5514", MIDDLE),
        ("EPSG:32633", np.array([400000.0, 5550000.0, 250.0])),
        ("EPSG:27561", np.array([999800.0, 112400.0, 150.0])),
    ],
)
def test_photos_see_the_same_ground_and_the_earth_s_curve__truth(
    crs: str, middle: np.ndarray
) -> None:
    block = block_over(crs, middle)
    made, _ = in_tangent_frame(block)
    for name, photo in block.photos.items():
        assert photo.exterior is not None
        own = [point for point in block.points if point.startswith(name)]
        places = np.array([block.points[point].position for point in own])
        # As the scan shows it: the ground lies lower the farther it is.
        away = np.sum((places - photo.exterior.centre)[:, :2] ** 2, axis=1)
        curved = places - np.outer(away / (2 * EARTH), [0.0, 0.0, 1.0])
        shown = pixels_of(curved, photo, block.cameras["c"])
        again = np.array([made.points[point].position for point in own])
        seen = pixels_of(again, made.photos[name], made.cameras["c"])
        assert np.abs(seen - shown).max() < 0.02
        # The curve is what a projected frame lacks.
        flat = pixels_of(places, photo, block.cameras["c"])
        assert np.abs(flat - shown).max() > 0.1
    assert made.crs == ""
    assert "tangent frame at longitude" in made.notes[-1]


def test_heights_and_distances_are_those_of_the_earth__oracle() -> None:
    frame = tangent_frame("EPSG:5514", MIDDLE)
    places = MIDDLE + np.array([[0.0, 0, 0], [0, 0, 100], [9000, 0, 0], [0, -12000, 50]])
    local = frame.from_object(places)
    assert np.abs(local[0]).max() < 1e-6
    assert local[1] == pytest.approx([0, 0, 100], abs=1e-6)
    bessel = Transformer.from_crs("EPSG:5514", "EPSG:4156", always_xy=True)
    lon, lat = bessel.transform(places[:, 0], places[:, 1])
    cart = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        "+step +proj=cart +ellps=bessel"
    )
    earth = np.column_stack(cart.transform(lon, lat, places[:, 2]))
    for one in range(4):
        for other in range(one):
            truth = np.linalg.norm(earth[one] - earth[other])
            assert np.linalg.norm(local[one] - local[other]) == pytest.approx(truth, abs=1e-6)
    assert frame.to_object(local) == pytest.approx(places, abs=1e-6)


def test_deviations_turn_with_the_meridian__truth() -> None:
    made, _ = in_tangent_frame(block_over("EPSG:5514", MIDDLE))
    sigma = made.photos["a"].sigma_centre_m
    assert sigma is not None
    assert sigma[2] == pytest.approx(0.3, abs=1e-3)
    assert np.hypot(*sigma[:2]) == pytest.approx(np.hypot(0.1, 0.2), abs=1e-3)
    # S-JTSK's north lies some eight degrees off true north here.
    assert 0.1 < sigma[0] < 0.11


def test_ties_go_along_and_unknown_ones_stay_unknown__truth() -> None:
    block = block_over("EPSG:5514", MIDDLE)
    positions = np.array([MIDDLE, [np.nan] * 3])
    index = np.array([0, 1])
    ties = ExchangeTies(("a",), index, np.zeros(2, int), np.ones((2, 2)), (), positions)
    made, frame = in_tangent_frame(
        ExchangeBlock(block.crs, block.cameras, block.photos, block.points, (), ties)
    )
    assert made.ties.positions is not None
    assert made.ties.positions[0] == pytest.approx(frame.from_object(MIDDLE[None])[0])
    assert np.isnan(made.ties.positions[1]).all()


@pytest.mark.parametrize("crs", ["", "EPSG:4326", "nonsense"])
def test_no_frame_without_a_map__truth(crs: str) -> None:
    with pytest.raises(CrsError):
        tangent_frame(crs, MIDDLE)
