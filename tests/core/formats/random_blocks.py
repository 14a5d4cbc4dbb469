"""Any blocks, for round trips, and what two of them must share."""

import numpy as np
from hypothesis import strategies as st

from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    ExchangeTies,
    pixels_of,
)
from core.geometry.exterior import ExteriorOrientation

SEEDS = st.integers(0, 2**31)
RAYS = np.array([[x, y, -1.0] for x in (-0.3, 0.0, 0.25) for y in (-0.2, 0.1, 0.3)])
"""Rays of image space."""


def block_of(seed: int, film: bool) -> ExchangeBlock:
    """A block of one camera and one to three photos; of film, each scan lies as it likes."""
    rng = np.random.default_rng(seed)

    def some(low: float, high: float, count: int) -> tuple[float, ...]:
        return tuple(rng.uniform(low, high, count).tolist())

    def perhaps(count: int) -> tuple[float, ...] | None:
        return some(1e-3, 9, count) if rng.random() < 0.5 else None

    marks = {f"P{n}": some(-110, 110, 2) for n in range(4)} if film else {}
    camera = ExchangeCamera(
        "RC10 1938", some(-0.01, 0.01, int(rng.integers(4))), some(-0.01, 0.01, 2), (9000, 8000),
        principal_distance_mm=some(80, 310, 1)[0] if film else None,
        principal_point_mm=some(-0.01, 0.01, 2) if film else (0.0, 0.0),
        fiducials_mm=marks,
    )  # fmt: skip
    photos: dict[str, ExchangePhoto] = {}
    for number in range(int(rng.integers(1, 4))):
        turn, scale, skew = some(-3, 3, 1) + some(-0.01, 0.01, 2) if film else (0.0, 0.0, 0.0)
        bend = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        bend = bend @ np.array([[7000.0 * (1 + scale), -skew], [0.0, -7000.0]])
        affine = np.column_stack([bend, [4321.125, 4001.375]])
        centre = np.array([1000.0, -2000.0, 3000.0]) + rng.normal(0, 50, 3)
        exterior = ExteriorOrientation(centre, *some(-0.3, 0.3, 2), *some(-3, 3, 1))
        name = f"{number}-{rng.choice(['a', 'b.c'])}"
        measured = {mark: some(0, 9000, 2) for mark in marks}
        photos[name] = ExchangePhoto(
            name, f"{name}.tif", camera.name, affine, exterior, perhaps(3), None, measured
        )
    points = {
        f"point{n}": ExchangePoint(
            f"point{n}",
            some(-1e6, 1e6, 3),
            perhaps(3),
            "check" if rng.random() < 0.5 else "control",
        )
        for n in range(int(rng.integers(5)))
    }
    measurements = tuple(
        ExchangeMeasurement(point, photo, *some(0, 9000, 2), *(perhaps(1) or (None,)))
        for point in points
        for photo in photos
    )
    return ExchangeBlock(
        "", {camera.name: camera}, photos, points, measurements, _ties(rng, tuple(photos))
    )


def _ties(rng: np.random.Generator, photos: tuple[str, ...]) -> ExchangeTies:
    """Twenty places, each seen in two photos or more."""
    if len(photos) < 2:
        return ExchangeTies.none()
    seen = rng.random((20, len(photos))) < 0.5
    seen[:, 0], seen[:, 1] = True, True
    point, photo = np.nonzero(seen)
    return ExchangeTies(photos, point, photo, rng.uniform(0, 9000, (len(point), 2)))


def assert_same_geometry(one: ExchangeBlock, other: ExchangeBlock, within_px: float = 1e-6) -> None:
    """Every photo of the first stands in the second and sees the ground at the same pixels."""
    assert set(one.photos) <= set(other.photos)
    for name, photo in one.photos.items():
        again = other.photos[name]
        assert photo.exterior is not None
        assert again.exterior is not None
        turned = photo.exterior.object_from_image.T @ again.exterior.object_from_image
        assert np.abs(turned - np.eye(3)).max() < 1e-9
        assert np.abs(photo.exterior.centre - again.exterior.centre).max() < 1e-6
        seen = 3000 * RAYS @ photo.exterior.object_from_image.T + photo.exterior.centre
        ours = pixels_of(seen, photo, one.camera_of(name))
        theirs = pixels_of(seen, again, other.camera_of(name))
        assert np.abs(ours - theirs).max() < within_px


def assert_same_points(one: ExchangeBlock, other: ExchangeBlock) -> None:
    """Surveyed points with their deviations and roles, and their measurements."""
    assert dict(one.points) == dict(other.points)

    def by_name(block: ExchangeBlock) -> dict[tuple[str, str], ExchangeMeasurement]:
        return {(m.point_id, m.photo_id): m for m in block.measurements}

    ours, theirs = by_name(one), by_name(other)
    assert set(ours) == set(theirs)
    for name, measurement in ours.items():
        again = theirs[name]
        assert abs(again.column - measurement.column) < 1e-6
        assert abs(again.row - measurement.row) < 1e-6
        assert again.sigma_px == measurement.sigma_px


def tie_set(block: ExchangeBlock) -> set[frozenset[tuple[str, float, float]]]:
    """Tie points as sets of rays, whatever their numbers."""
    ties, found = block.ties, {}
    for point, photo, (column, row) in zip(
        ties.point.tolist(), ties.photo.tolist(), ties.pixels.tolist(), strict=True
    ):
        ray = (ties.photo_ids[photo], round(column, 6), round(row, 6))
        found.setdefault(point, set()).add(ray)
    return {frozenset(rays) for rays in found.values()}
