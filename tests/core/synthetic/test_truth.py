"""Truth is read, and judges."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio

from core.block import Block, ExteriorPrior, Measurement, Photo, SurveyedPoint
from core.errors import ReferenceDataError
from core.geometry.collinearity import Atmosphere
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.synthetic.flight import make_flight
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import Truth, judge_control, judge_orientations, read_truth


def _true_block(truth: Truth) -> Block:
    """A block that knows everything."""
    photos = {}
    for name, exposure in truth.photos.items():
        turn, shift = exposure.pixel_from_film[:, :2], exposure.pixel_from_film[:, 2]
        back = np.linalg.inv(turn)
        interior = InteriorOrientation(
            "affine",
            np.column_stack([back, -back @ shift]),
            (),
            np.zeros((0, 2)),
            np.zeros((0, 2)),
            float("nan"),
        )
        prior = ExteriorPrior(np.full(3, 10.0), np.full(3, 0.01))
        ground = float(truth.heights[1].mean()) if truth.heights else 400.0
        photos[name] = Photo(
            name,
            Path(f"{name}.tif"),
            exposure.size_px,
            "true",
            interior,
            exposure.exterior,
            exposure.exterior,
            prior,
            ground,
            True,
        )
    return Block("EPSG:5514", {"true": truth.camera}, photos)


def _with_control(block: Block, truth: Truth, shift_px: float) -> Block:
    """Ten points on the true ground, measured in the first photo, the last of them shifted."""
    name = next(iter(truth.photos))
    exposure = truth.photos[name]
    film = np.random.default_rng(5).uniform(-70, 70, (10, 2))
    pixels = exposure.pixels(film)
    heights = np.full(10, block.photos[name].ground_height_m)
    for _ in range(6):
        ground = exposure.object_from_pixel(pixels, heights, truth.camera)
        heights = truth.heights_at(ground)
    ground[:, 2] += 0.5  # an error of the DEM is not an error of the measurement
    points = {
        f"P{k}": SurveyedPoint(f"P{k}", ground[k], np.ones(3), "control", "junction")
        for k in range(10)
    }
    pixels[9, 0] += shift_px
    measured = [Measurement(f"P{k}", name, *pixels[k].tolist(), 0.5) for k in range(10)]
    return replace(block, surveyed=points, measurements={m.key: m for m in measured})


def test_true_orientations_are_judged_true__truth(tiny_block):
    truth = read_truth(tiny_block)
    judged = judge_orientations(truth, _true_block(truth))
    assert len(judged.photo_ids) == 6
    assert np.abs(judged.centre_m).max() == 0.0
    assert judged.ground_m.max() < 1e-4  # the refraction of the mean ground


def test_orientation_errors_are_told__truth(tiny_block):
    truth = read_truth(tiny_block)
    block = _true_block(truth)
    name = next(iter(block.photos))
    true = block.photos[name].exterior
    other = ExteriorOrientation(
        true.centre + np.array([1.0, 0.0, 0.0]), true.omega, true.phi, true.kappa + 1e-3
    )
    block = block.with_photos({name: block.photos[name].with_exterior(other, True)})
    judged = judge_orientations(truth, block)
    assert judged.photo_ids == (name,)
    assert judged.centre_m[0, 0] == pytest.approx(1.0, abs=1e-9)
    assert judged.angles_deg[0, 2] == pytest.approx(np.degrees(1e-3), abs=1e-9)
    assert 1.0 < judged.ground_m[0] < 1.3


def test_one_wrong_control_measurement_is_counted__truth(tiny_block):
    truth = read_truth(tiny_block)
    judged = judge_control(truth, _with_control(_true_block(truth), truth, 4.0))
    assert (judged.used, judged.wrong) == (10, 1)
    assert judged.wrong_share == pytest.approx(0.1)
    assert judged.rms_m < 0.01
    assert max(judged.distances_m, key=judged.distances_m.__getitem__)[0] == "P9"


def test_rejected_measurements_and_check_points_are_not_judged__truth(tiny_block):
    truth = read_truth(tiny_block)
    block = _with_control(_true_block(truth), truth, 4.0)
    name = next(iter(truth.photos))
    bad = replace(block.measurements[("P9", name)], status="rejected")
    check = replace(block.surveyed["P8"], role="check")
    block = replace(block.with_measurement(bad), surveyed={**block.surveyed, "P8": check})
    judged = judge_control(truth, block)
    assert (judged.used, judged.wrong, judged.wrong_share) == (8, 0, 0.0)


def test_photo_model_of_the_block_agrees_with_the_truth__truth(tiny_block):
    """`Photo` with true orientations images the ground where the truth does."""
    truth = read_truth(tiny_block)
    block = _true_block(truth)
    for name, photo in block.photos.items():
        ground = truth.photos[name].object_from_pixel(
            np.array([[200.0, 300.0], [900.0, 850.0]]), np.array([240.0, 260.0]), truth.camera
        )
        ours = photo.pixel_from_object(ground, truth.camera)
        # The photo takes its refraction from the mean height of the ground, the truth knows it.
        assert np.abs(ours - np.array([[200.0, 300.0], [900.0, 850.0]])).max() < 0.002


def test_refraction_and_curvature_move_the_corner_as_in_the_formulae__paper():
    """dr = K (r + r^3 / c^2) outwards, dr = H r^3 / (2 R c^2) inwards, METHODS 7.2."""
    flight = make_flight(SyntheticOptions(size="tiny", seed=2, relief_m=0.0))
    exposure = flight.exposures[0]
    still = replace(exposure, exterior=ExteriorOrientation(exposure.exterior.centre, 0.0, 0.0, 0.0))
    ground_m = float(flight.terrain.heights(still.exterior.centre[None, :2])[0])
    high = float(still.exterior.centre[2]) - ground_m
    camera = flight.nominal
    r, c = 127.0, camera.principal_distance_mm
    away = r / c * high / np.sqrt(2)
    corner = np.array([[*(still.exterior.centre[:2] + away), ground_m]])
    bent = still.film(still.pixel_from_object(corner, camera))
    bare = replace(still, atmosphere=Atmosphere())
    straight = bare.film(bare.pixel_from_object(corner, camera))
    refraction = still.atmosphere.refraction * (r + r**3 / c**2)
    curvature = high * r**3 / (2 * 6_371_000.0 * c**2)
    moved = float(np.linalg.norm(bent) - np.linalg.norm(straight))
    assert refraction > 1e-3
    assert curvature > 1e-3
    assert moved == pytest.approx(refraction - curvature, abs=2e-5)


def test_truth_of_the_film_block_over_real_ground__real(shared_data):
    folder = shared_data / "vovcha-film"
    truth = read_truth(folder)
    assert len(truth.photos) == 6
    assert truth.camera.principal_distance_mm == 151.92
    assert truth.archival_ortho.is_file()
    # White crosses on black discs were drawn at whole pixels.
    errors = []
    for name, exposure in truth.photos.items():
        marks = np.array(list(truth.camera.fiducials_mm.values()))
        with rasterio.open(folder / "scans" / f"{name}.tif") as raster:
            for column, row in exposure.pixels(marks):
                left, top = int(column) - 40, int(row) - 40
                window = raster.read(1, window=((top, top + 81), (left, left + 81)))
                weight = np.clip(window.astype(np.float64) - 120.0, 0.0, None)
                x = (np.arange(left, left + 81) + 0.5) @ weight.sum(axis=0) / weight.sum()
                y = (np.arange(top, top + 81) + 0.5) @ weight.sum(axis=1) / weight.sum()
                errors.append((x - column, y - row))
    # Scratches cross some of them, so the median; half a pixel would show plainly.
    assert np.abs(np.median(errors, axis=0)).max() < 0.12


def test_missing_and_broken_truth_say_so__truth(tmp_path):
    with pytest.raises(ReferenceDataError, match="no truth"):
        read_truth(tmp_path)
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "truth.json").write_text('{"camera": {}}', encoding="utf-8")
    with pytest.raises(ReferenceDataError, match="cannot be read"):
        read_truth(tmp_path)
