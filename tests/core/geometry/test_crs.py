"""CRS checks: what is refused, and what the message says."""

from types import SimpleNamespace

import numpy as np
import pytest
from pyproj import CRS, Proj, Transformer
from pyproj.crs import BoundCRS
from pyproj.crs.coordinate_operation import ToWGS84Transformation

from core.errors import CrsError
from core.geometry.crs import (
    Bounds,
    bounds_of,
    check_range,
    infer_crs,
    operation_between,
    parse_crs,
    same_coordinates,
    short_name,
)
from core.geometry.map_in_space import check_scale, map_in_space, tangent_frame
from core.said import Said
from ui.words.catalogue import Teller

KOBYLI = np.array([[-576837.67, -1195069.54], [-574000.0, -1193000.0]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no CRS is given"),
        ("EPSG:99999", "does not know"),
        ("EPSG:4326", "does not count in metres"),
        ("EPSG:2263", "US survey foot"),
        ("EPSG:5513", "EPSG:5514"),
    ],
)
def test_a_block_crs_that_cannot_be_used_is_told__truth(text, words):
    with pytest.raises(CrsError, match=words) as caught:
        parse_crs(text, "block.toml [block] crs")
    assert caught.value.file == "block.toml [block] crs"
    assert caught.value.remedy


def test_a_block_crs_keeps_its_plane_part__truth():
    assert short_name(parse_crs("EPSG:5514+8357", "f")) == "EPSG:5514"
    assert parse_crs("EPSG:31467", "f").to_epsg() == 31467  # northing comes first in it


def around(crs: str, longitude: float, latitude: float) -> Bounds:
    """A block of ten kilometres."""
    east, north = Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(
        longitude, latitude
    )
    return east - 5e3, north - 5e3, east + 5e3, north + 5e3


@pytest.mark.parametrize("crs", ["EPSG:3395", "EPSG:6933", "EPSG:3035", "EPSG:5514", "EPSG:32633"])
def test_the_scale_of_a_map_is_what_proj_tells__oracle(crs: str) -> None:
    west, south, east, north = around(crs, 16.0, 49.0)
    place = np.array([(west + east) / 2, (south + north) / 2, 0.0])
    factors = Proj(crs).get_factors(16.0, 49.0)
    expected = factors.tissot_semiminor, factors.tissot_semimajor
    assert tangent_frame(crs, place).scales_at(place) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("crs", "place", "words"),
    [
        ("EPSG:3857", (15, 50), "as 1.557 m"),
        ("EPSG:3395", (15, 50), "as 1.553 m"),
        ("EPSG:6933", (15, 50), "as 1.346 m"),
        ("EPSG:3034", (15, 50), "as 0.966 m"),
    ],
)
def test_a_map_far_from_scale_one_is_refused__truth(
    crs: str, place: tuple[float, float], words: str
) -> None:
    with pytest.raises(CrsError, match=words) as told:
        check_scale(crs, around(crs, *place))
    assert "EPSG:32633" in told.value.remedy


@pytest.mark.parametrize(
    ("crs", "place", "film"),
    [
        ("EPSG:5514", (12.1, 50.2), ""),
        ("EPSG:32633", (18, 0), ""),  # at the border of its zone, where it bends most
        ("EPSG:32633", (22.5, 49), ""),  # as far beyond it as a block may lie
        ("EPSG:2154", (9, 42), ""),
        ("EPSG:27561", (7.7, 48.6), ""),  # counts longitudes in gons, from Paris
        ("EPSG:26910", (-123, 45), ""),
        ("EPSG:3035", (11, 52), ""),
        ("EPSG:3035", (15, 50), "57 µm"),
        ("EPSG:3035", (25, 35), "1742 µm"),
        ("EPSG:5070", (-98, 49), "1429 µm"),
    ],
)
def test_maps_that_surveys_use_are_doubted_at_most__truth(
    crs: str, place: tuple[float, float], film: str
) -> None:
    doubts = check_scale(crs, around(crs, *place))
    assert [film in doubt.message for doubt in doubts] == [True] * bool(film)


KROVAK = (
    "+proj=krovak +lat_0=49.5 +lon_0=24.83333333333333 +alpha=30.28813972222222 +k=0.9999 "
    "+x_0=0 +y_0=0 +ellps=bessel +towgs84=570.8,85.7,462.8,4.998,1.587,5.261,3.56 +units=m"
)


@pytest.mark.parametrize("text", [KROVAK, KROVAK + " +geoidgrids=egm96_15.gtx +vunits=m"])
def test_a_datum_told_by_towgs84_is_shifted_by_it__oracle(text: str) -> None:
    """Within the two metres that operations of S-JTSK differ by; without it, 118 m off."""
    crs = parse_crs(text, "f")
    expected = operation_between("EPSG:5514", "EPSG:32633", KOBYLI, "f").forward(KOBYLI)
    found = operation_between(crs.to_wkt(), "EPSG:32633", KOBYLI, "f").forward(KOBYLI)
    np.testing.assert_allclose(found, expected, atol=2.0)
    assert "Krovak" in short_name(crs)
    assert len(check_scale(text, bounds_of(KOBYLI))) == 0


def test_a_code_knows_its_datum_better_than_a_shift_beside_it__law() -> None:
    shift = ToWGS84Transformation(CRS("EPSG:4156"), 589, 76, 480)
    beside = BoundCRS(CRS("EPSG:5514"), CRS("EPSG:4326"), shift)
    assert parse_crs(beside.to_wkt(), "f") == CRS("EPSG:5514")


@pytest.mark.parametrize(
    ("points", "words", "remedy"),
    [
        (-KOBYLI, "first Y (west), then X (south)", "put a minus before both"),
        (-KOBYLI[:, ::-1], "first X (south), then Y (west)", "swap the two and put a minus"),
        (KOBYLI[:, ::-1], "easting and northing are swapped", "Swap the two"),
        (np.array([[16.7, 48.9]]), "km outside", "look like degrees"),
        (np.array([[620000.0, 5420000.0]]), "km outside", "Check the CRS"),
    ],
)
def test_slips_of_s_jtsk_are_recognised__truth(points, words, remedy):
    with pytest.raises(CrsError) as caught:
        check_range(CRS("EPSG:5514"), points, "roads.shp")
    assert words in caught.value.cause
    assert remedy in caught.value.remedy


def test_coordinates_that_fit_pass__truth():
    check_range(CRS("EPSG:5514"), KOBYLI, "f")
    check_range(CRS("EPSG:32633"), np.array([[622000.0, 5420000.0]]), "f")
    check_range(CRS("+proj=tmerc +lon_0=25 +datum=WGS84"), np.array([[-55094.0, -3727407.0]]), "f")


def test_swapped_utm_is_told__truth():
    with pytest.raises(CrsError, match="easting first"):
        check_range(CRS("EPSG:32633"), np.array([[9_100_000.0, 300_000.0]]), "f")


def test_a_missing_crs_is_the_blocks_or_told_by_range__truth():
    block = CRS("EPSG:5514")
    assert infer_crs(KOBYLI, block, "f") == block
    assert infer_crs(np.array([[622000.0, 5420000.0]]), block, "f") == CRS("EPSG:32633")
    with pytest.raises(CrsError, match="names no CRS"):
        infer_crs(np.array([[1e6, 2e6]]), block, "f")
    with pytest.raises(CrsError, match="positive"):
        infer_crs(-KOBYLI, block, "f")


def test_one_crs_under_two_names_is_one__truth():
    lo25 = "+proj=tmerc +lat_0=0 +lon_0=25 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
    other = CRS(lo25).to_wkt("WKT1_GDAL")
    points = np.array([[-55094.0, -3727407.0]])
    assert same_coordinates(lo25, other, points)
    assert not same_coordinates(lo25, "EPSG:32735", points)


def test_operations_are_the_nations_own_and_go_both_ways__truth():
    operation = operation_between("EPSG:5514", "EPSG:32633", KOBYLI, "f")
    assert operation.accuracy_m == 1.0  # PROJ's general answer for S-JTSK is good to 6 m
    there = operation.forward(KOBYLI)
    np.testing.assert_allclose(operation.backward(there), KOBYLI, atol=1e-3)
    lon, lat = operation_between("EPSG:32633", "EPSG:4326", there, "f").forward(there)[0]
    assert abs(lat - 48.92) < 0.02  # Kobyli
    assert abs(lon - 16.95) < 0.02


def test_an_operation_that_is_not_to_be_had_is_told__truth():
    with pytest.raises(CrsError, match="cannot bring"):
        operation_between("EPSG:32633", "EPSG:5514", np.array([[np.inf, 1e30]]), "f.tif")


def test_a_crs_that_counts_from_paris_knows_its_area__truth():
    """Strasbourg in Lambert Nord France; its area of use is told in degrees from Greenwich."""
    check_range(CRS("EPSG:27561"), np.array([[999604.58, 112344.443]]), "points.csv")
    with pytest.raises(CrsError):
        check_range(CRS("EPSG:27561"), np.array([[999604.58, 1112344.443]]), "points.csv")


def test_a_grid_that_is_missing_is_named_and_nothing_is_guessed__law(monkeypatch):
    """PROJ would take a ballpark operation without a word."""
    lacking = SimpleNamespace(grids=[SimpleNamespace(short_name="cz_cuzk_CR-2005.tif")])
    group = SimpleNamespace(transformers=[], unavailable_operations=[lacking])
    monkeypatch.setattr("core.geometry.crs.TransformerGroup", lambda *_, **__: group)
    with pytest.raises(CrsError, match=r"cz_cuzk_CR-2005\.tif"):
        operation_between("EPSG:5514", "EPSG:32633", np.array([[-743e3, -1043e3]]), "dem.tif")


def test_a_crs_without_code_or_name_is_told_in_every_language__law():
    method = "Transverse Mercator"
    found = short_name(CRS("+proj=tmerc +lat_0=0 +lon_0=15 +ellps=bessel"))
    assert isinstance(found, Said)
    assert found == f"an unnamed CRS ({method})"
    assert Teller("cs").again(found) == f"nepojmenovaný systém ({method})"


def test_the_way_to_wgs_84_is_the_best_one_there__oracle() -> None:
    """Files in degrees lay 0.75 m east and 0.65 m south of what the same place is in UTM."""
    best = operation_between("EPSG:5514", "EPSG:4326", KOBYLI, "").forward(KOBYLI)
    heights = np.column_stack([KOBYLI, [200.0, 300.0]])
    found = map_in_space(CRS.from_epsg(5514), near=KOBYLI).degrees(heights)
    # A shift of datum and its way back differ by a millimetre.
    assert np.abs(found[:, :2] - best).max() < 2e-8
