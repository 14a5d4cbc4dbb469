"""What goes out projects as it does here, whatever the format holds."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.exchange import fit_to_format, upright_frame
from core.formats.exchange import Conventions, ExchangeFormat, frame_camera, pixels_of
from core.formats.outlines import FOOTPRINTS_FORMAT, ground_height, ground_outline
from core.geometry.camera import additional_set
from core.geometry.collinearity import Atmosphere, film_from_object
from tests.flights import FlightPlan, fly

HOW = Conventions("", "", "", "", "", "", "")
FORMS = {
    "film": ExchangeFormat("film", "", HOW, "film", curved=False),
    "frame": ExchangeFormat("frame", "", HOW, "frame", curved=False),
    "upright": ExchangeFormat("upright", "", HOW, "upright", curved=False),
}
REPORT = adjust_block(
    fly(FlightPlan(), np.random.default_rng(918)).block, AdjustmentOptions(estimate_cameras=True)
)


def decentred(block):
    """The block with a lens whose elements do not stand in line: 8 micrometres at the edge."""
    basis = additional_set(("tangential",)).basis.reshape(2, -1)
    deformation = tuple((np.array([0.008, -0.005]) @ basis).tolist())
    cameras = {n: replace(c, deformation_mm=deformation) for n, c in block.cameras.items()}
    return replace(block, cameras=cameras)


@pytest.mark.parametrize("name", FORMS)
def test_what_goes_out_reprojects_as_it_does_here__law(name: str) -> None:
    """Residuals of ties are the same to half a hundredth of a pixel: what one camera for photos
    of hardly different refraction may cost (a tenth of that where each has its own)."""
    report = replace(REPORT, block=decentred(REPORT.block))
    block = report.block
    out = fit_to_format(block, report, FORMS[name])
    assert len(out.ties.point) > 300
    for number, photo_id in enumerate(out.ties.photo_ids):
        rays = out.ties.photo == number
        points = out.ties.positions[out.ties.point[rays]]
        photo, camera = block.photos[photo_id], block.camera_of(photo_id)
        numbers = np.array([int(out.ties.names[p][1:]) for p in out.ties.point[rays]])
        ours = block.ties.photo == block.ties.photo_ids.index(photo_id)
        by_tie = {int(p): row for row, p in enumerate(block.ties.point[ours])}
        pixels = block.ties.pixels[ours][[by_tie[int(n)] for n in numbers]]
        here = photo.pixel_from_object(points.copy(), camera) - pixels
        there = pixels_of(points, out.photos[photo_id], out.camera_of(photo_id))
        there = there - out.ties.pixels[rays]
        scan = photo.interior.film_from_pixel_matrix[:, :2] / photo.interior.pixel_size_mm
        if name == "upright":  # residuals are turned with the pixels
            here = here @ scan.T * np.array([1.0, -1.0])
        assert np.allclose(here, there, atol=5e-3)


def test_an_upright_frame_holds_its_photo__law() -> None:
    block = REPORT.block
    for name, photo in block.photos.items():
        camera = block.camera_of(name)
        frame = upright_frame(photo, camera)
        corners = frame.pixel_from_film(camera.frame_corners_mm)
        assert corners.min() >= -1e-9
        assert (corners.max(axis=0) <= np.array(frame.size_px)).all()


def test_upright_pixels_need_neither_affinity_nor_turn__law() -> None:
    out = fit_to_format(REPORT.block, REPORT, FORMS["upright"])
    for name, photo in out.photos.items():
        frame = frame_camera(photo, out.camera_of(name))
        assert abs(frame.affinity_px) < 1e-6
        assert abs(frame.skew_px) < 1e-6


def test_standard_deviations_go_with_the_photos__law() -> None:
    out = fit_to_format(REPORT.block, REPORT, FORMS["film"])
    for name, sigmas in REPORT.exterior_sigmas.items():
        assert out.photos[name].sigma_centre_m == tuple(sigmas.centre_m)
        assert out.photos[name].sigma_angles == tuple(sigmas.angles)


def test_points_from_photos_are_no_surveyed_points__law() -> None:
    block = REPORT.block
    name = next(key[0] for key, item in block.measurements.items() if item.used)
    fresh = replace(block.surveyed[name], role="new")
    out = fit_to_format(
        replace(block, surveyed={**block.surveyed, name: fresh}), REPORT, FORMS["film"]
    )
    assert set(out.points) == set(block.surveyed) - {name}
    assert {one.point_id for one in out.measurements} <= set(out.points)
    assert any(name in note for note in out.notes)


def test_photos_that_flew_equally_high_share_their_camera__law() -> None:
    """Refraction of one block hardly differs; film is held with one certificate."""
    assert set(fit_to_format(REPORT.block, REPORT, FORMS["film"]).cameras) == {"wide"}


def test_refraction_goes_into_a_camera_exactly__law(monkeypatch: pytest.MonkeyPatch) -> None:
    """K (1 + r^2 / c^2) is a scale and a radial term; nothing is left with a camera a photo."""
    monkeypatch.setattr("core.exchange.SAME_REFRACTION", 0.0)
    out = fit_to_format(REPORT.block, REPORT, replace(FORMS["film"], curved=True))
    assert len(out.cameras) == len(REPORT.block.photos)
    for name, photo in REPORT.block.photos.items():
        camera = REPORT.block.camera_of(name)
        points = out.ties.positions
        seen = film_from_object(
            points.copy(), photo.exterior, camera, Atmosphere(photo.atmosphere.refraction, 0.0)
        )
        there = pixels_of(points, out.photos[name], out.camera_of(name))
        assert np.allclose(photo.interior.pixel_from_film(seen), there, atol=1e-7)


def test_film_has_footprints_of_its_picture_area__truth() -> None:
    """To a metre: half of it is the Earth's curvature, which level ground leaves out."""
    block = decentred(REPORT.block)
    cameras = {n: replace(c, principal_point_mm=(0.4, -0.3)) for n, c in block.cameras.items()}
    block = replace(block, cameras=cameras)
    out = fit_to_format(block, REPORT, FOOTPRINTS_FORMAT)
    level = ground_height(out)
    assert level is not None
    for name, photo in block.photos.items():
        camera = block.camera_of(name)
        half = np.array(camera.frame_mm) / 2
        film = np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)]) * half
        pixels = photo.interior.pixel_from_film(film)
        expected = photo.object_from_pixel(pixels, np.full(4, level), camera)[:, :2]
        ring = ground_outline(out, out.photos[name])
        assert ring is not None
        apart = np.linalg.norm(np.array(ring)[:, None] - expected, axis=2)
        assert apart.min(axis=0).max() < 1.0, name
