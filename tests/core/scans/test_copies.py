"""Marks of shapes that no list knows: from one that was shown, and from their repeating alone."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.doubts import Failure
from core.geometry.camera import Camera
from core.raster.scan_file import open_scan
from core.scans.constellation import LIBRARY, Constellation, find_constellation
from core.scans.copies import mark_shown_at, measure_like
from core.scans.corner_sets import measure_corners
from core.scans.corners import centre_by_corner, edges_about
from core.scans.film_area import FilmArea, detect_film_area
from core.scans.judging import FiducialMeasurement, FiducialSet
from core.scans.naming import CORNERS, guessed_layouts
from core.scans.naming import SIDES as SIDES_MM
from core.scans.repeated import repeated_marks, with_repeated
from tests.core.scans.film_maker import FIDUCIALS, Film, film_from_pixel, make_film, write_gray

CAMERA = Camera("little", 60.0, (60.0, 60.0), fiducials_mm=FIDUCIALS)
UNKNOWN = replace(CAMERA, fiducials_mm={})
SIDES = {"5": (0.0, 27.0), "6": (27.0, 0.0), "7": (0.0, -27.0), "8": (-27.0, 0.0)}
GOAL_PX = 0.2
LOOSE_PX = 0.4
"""What is not symmetric has no middle of its own: the picture about the first one goes with it."""
PIXEL_MM = 0.04


Truth = dict[str, tuple[float, float]]
Films = Callable[[str], tuple[Path, Truth]]


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Films:
    """Films by the kind of their marks, each made once."""
    folder = tmp_path_factory.mktemp("films")

    @cache
    def made(kind: str) -> tuple[Path, Truth]:
        path = folder / f"{kind}.tif"
        at_sides = kind in ("notch", "half-arrow")
        return path, make_film(path, Film(kind=kind, fiducials=SIDES if at_sides else FIDUCIALS), 1)

    return made


def copies(
    path: Path, truth: Truth, camera: Camera, off: tuple[float, float] = (0.0, 0.0)
) -> FiducialSet:
    """Marks like the first, pointed at a little beside its middle."""
    scan = open_scan(path)
    area: FilmArea = detect_film_area(scan, camera, PIXEL_MM)
    first = next(iter(truth.values()))
    shown = mark_shown_at(scan, area, (first[0] + off[0], first[1] + off[1]), PIXEL_MM)
    return measure_like(scan, camera, PIXEL_MM, area, shown)


def off_px(found: FiducialSet, truth: Truth) -> np.ndarray:
    """How far each mark lies from the truth that is nearest."""
    places = np.array(list(truth.values()))
    return np.array(
        [np.linalg.norm(places - np.array(mark.place), axis=1).min() for mark in found.marks]
    )


@pytest.mark.parametrize("kind", ["saltire", "star", "key"])
@pytest.mark.parametrize("camera", [CAMERA, UNKNOWN], ids=["certified", "unknown"])
def test_one_that_is_shown_finds_the_others__truth(films: Films, kind: str, camera: Camera) -> None:
    path, truth = films(kind)
    found = copies(path, truth, camera)
    assert len(found.marks) == 4
    assert off_px(found, truth).max() < (LOOSE_PX if kind == "key" else GOAL_PX)


def test_a_click_beside_a_symmetric_mark_is_enough__truth(films: Films) -> None:
    path, truth = films("saltire")
    found = copies(path, truth, CAMERA, off=(2.5, -1.5))
    assert len(found.marks) == 4
    assert off_px(found, truth).max() < GOAL_PX


@pytest.mark.parametrize("kind", ["notch", "half-arrow"])
def test_a_notch_in_strong_texture_is_right_or_doubted__truth(films: Films, kind: str) -> None:
    """The picture beside it is another at every side; on real film it is found (tests/real)."""
    path, truth = films(kind)
    found = copies(path, truth, UNKNOWN)
    doubted = {doubt.evidence.get("fiducial") for doubt in found.doubts}
    assert doubted
    off = dict(zip([mark.name for mark in found.marks], off_px(found, truth), strict=True))
    sigmas = {mark.name: mark.sigma_px for mark in found.marks}
    assert all(value < 1.0 or name in doubted for name, value in off.items())
    assert all(value < 1.0 or value < 3 * np.sqrt(2) * sigmas[name] for name, value in off.items())


def test_a_tip_at_the_edge_of_the_scan_stands_by_its_sides__truth(tmp_path: Path) -> None:
    film = Film(fiducials={}, turn_deg=0.0)
    make_film(tmp_path / "film.tif", film, 1)
    gray = cv2.imread(str(tmp_path / "film.tif"), cv2.IMREAD_GRAYSCALE)
    assert gray is not None
    certified = {name: (31.2 * x, 31.2 * y) for name, (x, y) in SIDES_MM.items()}
    camera = replace(CAMERA, fiducials_mm=certified)
    matrix, truth = film_from_pixel(film, gray.shape[0]), {}
    for name, (x, y) in SIDES_MM.items():
        out, along = np.array([x, y]), np.array([-y, x])
        tooth = np.array([31.2 * out, 29 * out + 1.3 * along, 29 * out - 1.3 * along])
        at = np.linalg.solve(matrix[:, :2], (tooth - matrix[:, 2]).T).T
        cv2.fillPoly(gray, [np.rint((at - 0.5) * 16).astype(np.int32)], 200, cv2.LINE_AA, 4)
        truth[name] = at[0]
    first = int(truth["T"][1]) - 3
    write_gray(tmp_path / "cut.tif", gray[first:])
    there = {name: (float(at[0]), float(at[1]) - first) for name, at in truth.items()}
    found = copies(tmp_path / "cut.tif", {"L": there["L"], **there}, camera)
    marks = {mark.name: mark for mark in found.marks}
    assert np.hypot(*np.subtract(marks["T"].place, there["T"])) < 1
    # Where it is cut at its foot too little is left.
    write_gray(tmp_path / "cut.tif", gray[first + 30 :])
    there = {name: (column, row - 30) for name, (column, row) in there.items()}
    found = copies(tmp_path / "cut.tif", {"L": there["L"], **there}, camera)
    assert "T" not in {mark.name for mark in found.marks}


def test_what_stands_nowhere_else_is_not_found__truth(tmp_path: Path) -> None:
    """Of one mark alone there are no copies, and no landscape is taken for them."""
    for seed in range(2):
        path = tmp_path / f"{seed}.tif"
        truth = make_film(path, Film(kind="star", missing=("2", "3", "4")), seed)
        found = copies(path, truth, UNKNOWN)
        elsewhere = [
            mark
            for mark in found.marks
            if np.hypot(mark.column - truth["1"][0], mark.row - truth["1"][1]) > GOAL_PX
        ]
        assert not elsewhere


def test_what_repeats_is_shown_at_its_middle__truth(films: Films) -> None:
    path, truth = films("saltire")
    scan = open_scan(path)
    area = detect_film_area(scan, UNKNOWN, PIXEL_MM)
    places = np.array(list(truth.values()))
    likeliest = next(repeated_marks(scan, UNKNOWN, PIXEL_MM, area, "corners"))
    assert np.linalg.norm(places - np.array(likeliest.place), axis=1).min() < 1.0


@pytest.mark.parametrize("kind", ["saltire", "notch"])
def test_marks_of_no_known_kind_are_found_by_repeating__truth(films: Films, kind: str) -> None:
    """Figures that are symmetric about a point, and corners of the frame in strong texture."""
    path, truth = films(kind)
    scan = open_scan(path)
    area = detect_film_area(scan, UNKNOWN, PIXEL_MM)
    result = with_repeated(scan, UNKNOWN, PIXEL_MM, area, FiducialSet((), ()))
    assert len(result.marks) == 4
    assert {doubt.evidence["fiducial"] for doubt in result.doubts} == {m.name for m in result.marks}
    assert off_px(result, truth).max() < 1.0


def test_two_edges_meet_where_they_were_drawn__truth() -> None:
    """A corner of 60 degrees between noisy grays, pointed at beside its tip."""
    rng = np.random.default_rng(5)
    column, row = np.meshgrid(*2 * (np.arange(0.5, 120.0),))
    tip = np.array([61.3, 57.8])
    angle = np.arctan2(row - tip[1], column - tip[0]) % (2 * np.pi)
    drawn = np.where((angle > np.radians(20)) & (angle < np.radians(80)), 180.0, 30.0)
    gray = cv2.GaussianBlur(drawn, (0, 0), 1.2) + rng.normal(0, 4, drawn.shape)
    found = edges_about(gray.astype(np.float32), (64.0, 55.0), 8.0, 0.03)
    assert found is not None
    edges = found[1]
    assert [round(np.degrees(edge.angle)) for edge in edges] == [20, 80]
    both = centre_by_corner(gray.astype(np.float32), (64.0, 55.0), 8.0, edges, 0.03)
    assert not isinstance(both, Failure)
    for centre in both:
        # Near the tip the other edge reaches into what lies beside each.
        assert np.hypot(centre.column - tip[0], centre.row - tip[1]) < GOAL_PX
        assert centre.sigma_px < GOAL_PX / 2


def placed(kinds: dict[str, tuple[float, float]], turn_deg: float) -> FiducialSet:
    """Marks at places on the film, millimetres, of a scan whose film is turned."""
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    marks = [
        FiducialMeasurement(name, *(900 + rotation @ (x, -y) / PIXEL_MM), 0.1, 0.9, 0.0, "cross")
        for name, (x, y) in kinds.items()
    ]
    return FiducialSet(tuple(marks), ())


@pytest.mark.parametrize("lost", ["T", "R", "B", "L"])
def test_three_sides_tell_the_middle__truth(lost: str) -> None:
    """The box about three marks of sides has its middle elsewhere."""
    sides = {name: (27 * x, 27 * y) for name, (x, y) in SIDES_MM.items() if name != lost}
    assert placed(sides, 0.8).middle == pytest.approx((900, 900), abs=1e-6)


def test_one_notch_points_at_the_middle_that_four_corners_tell__truth(
    tmp_path: Path,
) -> None:
    """The other sides have none; without the corners one alone may be chance."""
    film = Film(kind="notch", fiducials=SIDES, missing=("5", "7", "8"))
    truth = make_film(tmp_path / "one.tif", film, 1)
    scan = open_scan(tmp_path / "one.tif")
    area = detect_film_area(scan, UNKNOWN, PIXEL_MM)
    size = scan.size_px[0]
    film_mm = film_from_pixel(film, size)
    corners = {name: (25 * x, 25 * y) for name, (x, y) in CORNERS.items()}
    places = (np.array(list(corners.values())) - film_mm[:, 2]) @ np.linalg.inv(film_mm[:, :2]).T
    known = [
        FiducialMeasurement(name, column, row, 0.1, 0.9, 0.0, "cross")
        for name, (column, row) in zip(corners, places.tolist(), strict=True)
    ]
    found = measure_corners(scan, UNKNOWN, PIXEL_MM, area, known=known)
    assert isinstance(found, FiducialSet)
    assert [mark.name for mark in found.marks] == ["R"]
    assert np.hypot(*np.subtract(found.marks[0].place, truth["6"])) < 1.0
    assert isinstance(measure_corners(scan, UNKNOWN, PIXEL_MM, area), Failure)


@pytest.mark.parametrize("marked", [True, False])
def test_dim_crosses_beside_bright_picture_are_seen__truth(tmp_path: Path, marked: bool) -> None:
    """Twelve grays high, where light falls off by a hundred within two millimetres."""
    rng = np.random.default_rng(9131)
    size, inset = 1700, 130
    column, row = np.meshgrid(*2 * (np.arange(0.5, size),))
    rim = np.min([column, row, size - column, size - row], axis=0)
    gray = 30 + 150 / (1 + np.exp(-(rim - inset - 35) / 15)) + 10 * np.sin(column / 9) * (rim > 200)
    middles = [(x, y) for y in (inset, size - inset) for x in (inset, size - inset)]
    for x, y in middles if marked else ():
        right, down = np.abs(column - x), np.abs(row - y)
        arms = (np.abs(right - down) < 3) & (np.maximum(right, down) < 26) & (right + down > 14)
        gray = gray + 12 * cv2.GaussianBlur(arms.astype(np.float64), (0, 0), 1.0)
    path = tmp_path / "dim.tif"
    write_gray(path, np.clip(gray + rng.normal(0, 4, gray.shape), 0, 255).astype(np.uint8))
    scan = open_scan(path)
    border = np.array([[80.0, 1620.0], [1620.0, 1620.0], [1620.0, 80.0], [80.0, 80.0]])
    area = FilmArea(border, ("left", "right", "top", "bottom"), np.ones(4))
    figures = tuple(mark for mark in LIBRARY if mark.symmetric)
    layout = guessed_layouts(UNKNOWN)[0]
    plain, dim = (
        find_constellation(scan, layout, PIXEL_MM, area, marks=figures, dim=dim)
        for dim in (False, True)
    )
    assert isinstance(dim, Constellation) == marked
    if isinstance(dim, Constellation):
        away = np.linalg.norm(dim.pixels[:, None] - np.array(middles)[None], axis=2).min(axis=1)
        assert away.max() < 2
        assert isinstance(plain, Failure)
