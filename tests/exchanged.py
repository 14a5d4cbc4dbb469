"""Random exchanged blocks, and what two of them have in common: for round trips of any format."""

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    ExchangeTies,
    Holds,
    frame_camera,
    pixels_of,
)
from core.geometry.exterior import ExteriorOrientation

Recipe = tuple[int, int, int, bool]
"""Seed, number of photos, radial terms, whether the lens is tangential."""
RECIPES = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(0, 3), st.booleans())
"""Plain numbers, because values that are checked at every call would slow hypothesis down."""
CRS = "EPSG:5514"
MIDDLE = np.array([-743000.0, -1043000.0, 300.0])
SIZE = (9000, 8800)
HEIGHT = 3000.0


def block_of(recipe: Recipe, holds: Holds = "film", crs: str = CRS) -> ExchangeBlock:
    """A block over flat ground near Prague, everything known, as a format of that kind holds it.

    Photos of one camera have scans of their own: turned and sheared for `film`, upright with
    affinity and skew for `frame`, one upright interior orientation for a camera for `upright`.
    """
    seed, photos, radial, tangential = recipe
    rng = np.random.default_rng(seed)
    cameras = {
        name: _camera(name, rng, radial, tangential) for name in ("wide", "normal")[: 1 + seed % 2]
    }
    upright = {name: _affine(rng, "upright") for name in cameras}
    made: dict[str, ExchangePhoto] = {}
    for number in range(photos):
        camera = list(cameras)[number % len(cameras)]
        affine = upright[camera] if holds in ("upright", "nothing") else _affine(rng, holds)
        name = f"1938_{number:03d}"
        made[name] = _photo(name, camera, affine, rng)
    points = {f"P{number}": _point(f"P{number}", rng) for number in range(5)}
    block = ExchangeBlock(crs, cameras, made, points)
    return ExchangeBlock(crs, cameras, made, points, _measurements(block, rng), _ties(block, rng))


def assert_same_geometry(block: ExchangeBlock, again: ExchangeBlock, px: float = 1e-6) -> None:
    """Photos stand where they stood (1e-6 m, 1e-9 rad) and show what they showed (px)."""
    assert list(again.photos) == list(block.photos)
    ground = GROUND + MIDDLE
    for name, photo in block.photos.items():
        other = again.photos[name]
        before = frame_camera(photo, block.camera_of(name)).with_rotation_and_centre()
        after = frame_camera(other, again.camera_of(name)).with_rotation_and_centre()
        assert np.abs(after[1] - before[1]).max() < 1e-6, name
        assert np.abs(after[0] - before[0]).max() < 1e-9, name
        shown = pixels_of(ground, photo, block.camera_of(name))
        then = pixels_of(ground, other, again.camera_of(name))
        # 1 m at 3 km is 3 px here; a fold of the lens far outside the scan is no one's business.
        inside = np.all((shown > 0) & (shown < np.array(SIZE)), axis=1)
        assert inside.any(), name
        assert np.abs(then - shown)[inside].max() < px, name


def assert_same_points(block: ExchangeBlock, again: ExchangeBlock, m: float = 1e-6) -> None:
    """Surveyed points are where they were."""
    assert set(again.points) == set(block.points)
    for name, point in block.points.items():
        assert np.allclose(again.points[name].position, point.position, rtol=0, atol=m), name


def assert_same_measurements(block: ExchangeBlock, again: ExchangeBlock, px: float = 1e-6) -> None:
    """The same points are measured in the same photos at the same places."""
    before, after = _measured(block), _measured(again)
    assert set(after) == set(before)
    for key, place in before.items():
        assert np.allclose(after[key], place, rtol=0, atol=px), key


def assert_same_ties(block: ExchangeBlock, again: ExchangeBlock, px: float = 1e-6) -> None:
    """The same rays belong to the same tie points, in whatever order."""
    (before, points), (after, others) = _rays(block.ties), _rays(again.ties)
    assert np.allclose(after, before, rtol=0, atol=px)
    assert np.array_equal(points, others)


GROUND = np.array(
    [[e, n, h] for e in range(-1500, 1501, 500) for n in range(-1500, 1501, 500) for h in (0, 200)],
    dtype=np.float64,
)


def _camera(name: str, rng: np.random.Generator, radial: int, tangential: bool) -> ExchangeCamera:
    """A lens that bends by some pixels, on film with fiducials."""
    size = np.array([1e-2, 1e-2, 1e-3])[:radial]
    lens = tuple((size * rng.uniform(-1, 1, radial)).tolist())
    p1, p2 = rng.uniform(-1e-3, 1e-3, 2).tolist() if tangential else (0.0, 0.0)
    marks = {str(n + 1): (84.5 * x, 84.5 * y) for n, (x, y) in enumerate(CORNERS)}
    return ExchangeCamera(
        name, lens, (p1, p2), SIZE, 211.59, (0.013, -0.021), (180.0, 180.0), marks
    )


CORNERS = ((-1, 0), (1, 0), (0, 1), (0, -1))


def _affine(rng: np.random.Generator, holds: Holds) -> np.ndarray:
    """pixel_from_image of a scan."""
    matrix = np.diag([1.0, -1.0])
    if holds in ("film", "frame"):
        scale, skew = rng.uniform(-3e-3, 3e-3, 2)
        matrix = np.array([[1 + scale, skew], [0, 1]]) @ matrix
    if holds == "film":
        turn = rng.uniform(-np.pi, np.pi)
        matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ matrix
    focal = rng.uniform(8000, 10000)
    return np.column_stack([focal * matrix, np.array(SIZE) / 2 + rng.uniform(-90, 90, 2)])


def _photo(name: str, camera: str, affine: np.ndarray, rng: np.random.Generator) -> ExchangePhoto:
    """A photo that looks down, more or less, with fiducials where they may be."""
    angles = (*rng.uniform(-0.15, 0.15, 2).tolist(), float(rng.uniform(-3.1, 3.1)))
    centre = MIDDLE + np.array([*rng.uniform(-400, 400, 2), HEIGHT + rng.uniform(-50, 50)])
    fiducials = {
        str(n + 1): (float(x), float(y)) for n, (x, y) in enumerate(rng.uniform(100, 8000, (4, 2)))
    }
    return ExchangePhoto(
        name,
        f"{name}.tif",
        camera,
        affine,
        ExteriorOrientation(centre, *angles),
        _three(rng.uniform(0.1, 2, 3)),
        _three(rng.uniform(1e-5, 1e-3, 3)),
        fiducials,
    )


def _point(name: str, rng: np.random.Generator) -> ExchangePoint:
    """A surveyed point on the ground that the photos show."""
    place = MIDDLE + rng.uniform([-900, -900, 0], [900, 900, 150])
    role = "check" if rng.random() < 0.5 else "control"
    return ExchangePoint(name, _three(place), _three(rng.uniform(0.01, 0.5, 3)), role)


def _measurements(
    block: ExchangeBlock, rng: np.random.Generator
) -> tuple[ExchangeMeasurement, ...]:
    """Every point in every photo, with noise."""
    made: list[ExchangeMeasurement] = []
    for name, photo in block.photos.items():
        places = np.array([point.position for point in block.points.values()])
        pixels = pixels_of(places, photo, block.camera_of(name)) + rng.normal(0, 0.3, (5, 2))
        for point, (column, row) in zip(block.points, pixels.tolist(), strict=True):
            sigma = float(rng.uniform(0.1, 2))
            made.append(ExchangeMeasurement(point, name, column, row, sigma))
    return tuple(made)


def _ties(block: ExchangeBlock, rng: np.random.Generator) -> ExchangeTies:
    """Tie points of two photos and more; none where there is but one photo."""
    names = tuple(block.photos)
    if len(names) < 2:
        return ExchangeTies.none()
    places = MIDDLE + rng.uniform([-600, -600, 0], [600, 600, 150], (12, 3))
    seen = [sorted(rng.permutation(len(names))[: rng.integers(2, len(names) + 1)]) for _ in places]
    point = np.array([number for number, rays in enumerate(seen) for _ in rays])
    photo = np.array([one for rays in seen for one in rays])
    pixels = np.zeros((len(point), 2))
    for number, name in enumerate(names):
        rays = photo == number
        pixels[rays] = pixels_of(places[point[rays]], block.photos[name], block.camera_of(name))
    pixels += rng.normal(0, 0.3, pixels.shape)
    titles = tuple(f"T{number}" for number in range(len(places)))
    sigmas = rng.uniform(0.1, 1, len(point))
    return ExchangeTies(names, point, photo, pixels, titles, places, sigmas)


def _three(values: np.ndarray) -> tuple[float, float, float]:
    first, second, third = values.tolist()
    return first, second, third


def _measured(block: ExchangeBlock) -> dict[tuple[str, str], Sequence[float]]:
    return {(one.point_id, one.photo_id): (one.column, one.row) for one in block.measurements}


def _rays(ties: ExchangeTies) -> tuple[np.ndarray, np.ndarray]:
    """Column and row of all rays by photo and column, and their points in order of appearance."""
    names = np.array(ties.photo_ids)[ties.photo] if len(ties.photo) else np.zeros(0, str)
    order = np.lexsort((ties.pixels[:, 0], names))
    _, first, point = np.unique(ties.point[order], return_index=True, return_inverse=True)
    return ties.pixels[order], first[point]
