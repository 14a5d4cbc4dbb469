"""Details of photos alone: one ray says where the next photo shows them, and how surely."""

from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.arrays import Scalars
from core.block import HAND_SIGMA_PX, UNKNOWN_M, Block, Measurement, SurveyedPoint
from core.control.located import ABOVE_GROUND_M
from core.control.new_points import places_of_new_points
from core.control.prediction import covariances_of, predict_points
from tests.flights import FlightPlan, fly

UNKNOWN = np.full(3, UNKNOWN_M)
OPTIONS = AdjustmentOptions()


@dataclass(frozen=True)
class Ground:
    """The terrain beside a point, which stands above or below it."""

    height_m: float

    def heights(self, points: np.ndarray) -> Scalars:
        return np.full(len(points), self.height_m)


def clicked(block: Block, true: Block, name: str, photo_ids: list[str], rng) -> Block:
    """A block with a new point measured in some photos."""
    place = true.surveyed[name].position
    point = SurveyedPoint("N001", place + rng.normal(0, 30.0, 3), UNKNOWN, "new", "hand")
    measured = {}
    for photo_id in photo_ids:
        camera = true.camera_of(photo_id)
        pixel = true.photos[photo_id].pixel_from_object(place[None], camera)[0]
        at = (pixel + rng.normal(0, HAND_SIGMA_PX, 2)).tolist()
        measured["N001", photo_id] = Measurement(
            "N001", photo_id, *at, HAND_SIGMA_PX, status="accepted"
        )
    return replace(
        block,
        surveyed={**block.surveyed, "N001": point},
        measurements={**block.measurements, **measured},
    )


def test_one_ray_says_where_other_photos_show_a_detail__truth():
    """Ellipses are long where the height is not known, and hold the truth as they say."""
    squares, shapes = [], []
    for seed in range(12):
        rng = np.random.default_rng(300 + seed)
        flight = fly(FlightPlan(ties=300, control=14, check=8), rng)
        report = adjust_block(flight.block, OPTIONS)
        known = covariances_of(influence_of(report, OPTIONS))
        checks = [name for name, p in flight.truth.surveyed.items() if p.role == "check"]
        for name in checks:
            seen = [photo for point, photo in flight.block.measurements if point == name]
            if len(seen) < 2:
                continue
            place = flight.truth.surveyed[name].position
            ground = Ground(float(place[2] + rng.normal(0, ABOVE_GROUND_M)))
            block = clicked(report.block, flight.truth, name, seen[:1], rng)
            new = places_of_new_points(block, report, ground, known)["N001"]
            found = predict_points(
                block, [new.point], known, report.sigma_nought, {"N001": new.covariance}
            )
            for photo_id in seen[1:]:
                one = found["N001", photo_id]
                camera = flight.truth.camera_of(photo_id)
                true = flight.truth.photos[photo_id].pixel_from_object(place[None], camera)[0]
                away = np.array([one.column, one.row]) - true
                squares.append(away @ np.linalg.solve(one.covariance, away))
                shapes.append(np.sqrt(np.linalg.cond(one.covariance)))
    assert len(squares) > 50
    # What two photos of a block are off together counts twice: ellipses are half again too long.
    assert 0.3 < np.mean(squares) / 2 < 1.2
    assert np.median(shapes) > 3.0


def test_two_rays_give_what_the_adjustment_says__law():
    rng = np.random.default_rng(3)
    flight = fly(FlightPlan(ties=300, control=14, check=8), rng)
    rays = {
        n: [photo for point, photo in flight.block.measurements if point == n]
        for n, p in flight.truth.surveyed.items()
        if p.role == "check"
    }
    name = next(n for n, photos in rays.items() if len(photos) > 2)
    seen, known = rays[name][:2], {}
    block = clicked(flight.block, flight.truth, name, seen, rng)
    report = adjust_block(block, OPTIONS)
    ground = Ground(0.0)
    new = places_of_new_points(report.block, report, ground, known)["N001"].point
    told = next(point for point in report.new_points if point.point_id == "N001")
    np.testing.assert_array_equal(new.position, told.position)
    np.testing.assert_array_equal(new.sigma_m, told.sigma_m)
    # A third ray makes it another point: what was said of two does not stand.
    more = clicked(report.block, flight.truth, name, rays[name][2:3], rng)
    assert not np.array_equal(
        places_of_new_points(more, report, ground, known)["N001"].point.position, told.position
    )
