"""The exchanged block: image coordinates, and the camera as most programs hold it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation as Turn

from core.errors import PhotogrammetryError
from core.formats.exchange import (
    ExchangeCamera,
    ExchangeFormat,
    ExchangePhoto,
    Pair,
    frame_camera,
    from_frame_camera,
    ideal_from_image,
    image_from_ideal,
    pixels_of,
    read_format,
)
from core.formats.exchange_formats import FORMATS
from core.geometry.exterior import ExteriorOrientation
from tests.exchanged import MIDDLE, block_of

SMALL = st.floats(-1e-2, 1e-2)
ANGLE = st.floats(-0.3, 0.3)


NUMBERS = st.tuples(
    st.tuples(SMALL, SMALL), st.tuples(SMALL, SMALL), st.floats(-3.1, 3.1), st.floats(1e3, 2e4),
    st.tuples(SMALL, SMALL), st.floats(0, 9000), st.tuples(ANGLE, ANGLE, st.floats(-3, 3)),
)  # fmt: skip
Numbers = tuple[Pair, Pair, float, float, Pair, float, tuple[float, float, float]]


def photo_of(numbers: Numbers) -> tuple[ExchangePhoto, ExchangeCamera]:
    """Any photo of any camera whose scan lies turned and skewed."""
    radial, tangential, turn, focal, (scale, skew), column, angles = numbers
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    affine = rotation @ np.array([[1 + scale, skew], [0, 1]]) @ np.diag([1.0, -1.0])
    matrix = np.column_stack([focal * affine, [column, 4000.0]])
    exterior = ExteriorOrientation(np.array([1000.0, -2000.0, 3000.0]), *angles)
    return ExchangePhoto("a", "a.tif", "c", matrix, exterior), ExchangeCamera(
        "c", radial, tangential
    )


GROUND = np.array([[e, n, h] for e in (0, 900, 2100) for n in (-2900, -1400) for h in (0.0, 250)])


@given(NUMBERS)
@settings(max_examples=50)
def test_opencv_projects_our_frame_camera_where_we_do__oracle(numbers: Numbers) -> None:
    photo, camera = photo_of(numbers)
    ours = pixels_of(GROUND, photo, camera)
    frame = frame_camera(photo, camera)
    rotation, centre = frame.with_rotation_and_centre()
    lens = np.array([*frame.radial, *frame.tangential])
    # cv2.Rodrigues loses five digits of turns by half a circle; what it makes of an axis holds.
    distorted, _ = cv2.projectPoints(
        GROUND - centre, Turn.from_matrix(rotation).as_rotvec(), np.zeros(3), np.eye(3), lens
    )
    u, v = distorted.reshape(-1, 2).T
    column = frame.principal_point_px[0] + (frame.focal_px + frame.affinity_px) * u
    column += frame.skew_px * v
    row = frame.principal_point_px[1] + frame.focal_px * v
    assert np.allclose(np.column_stack([column, row]), ours, atol=1e-6)


@given(NUMBERS)
@settings(max_examples=50)
def test_a_frame_camera_comes_back_as_the_same_photo__law(numbers: Numbers) -> None:
    photo, camera = photo_of(numbers)
    matrix, tangential, exterior = from_frame_camera(frame_camera(photo, camera))
    again = ExchangePhoto("a", "a.tif", "c", matrix, exterior)
    lens = ExchangeCamera("c", camera.radial, tangential)
    assert np.allclose(pixels_of(GROUND, again, lens), pixels_of(GROUND, photo, camera), atol=1e-6)


@pytest.mark.parametrize(
    "form", [one for one in FORMATS.values() if one.write and one.holds in ("film", "frame")]
)
def test_a_scan_from_the_films_back_goes_out_or_is_told__law(
    form: ExchangeFormat, tmp_path: Path
) -> None:
    block = block_of((7, 3, 1, False), form.holds)
    name, photo = next(iter(block.photos.items()))
    back = replace(photo, pixel_from_image=photo.interior * np.array([-1.0, 1.0, 1.0]))
    path = tmp_path / (form.default_name or form.name)
    if form.folder:
        path.mkdir()
    assert form.write is not None
    out = replace(block, photos={**block.photos, name: back})
    notes = form.write(path, out)
    if form.name in ("metashape", "mmvii"):
        assert any(name in note for note in notes)
    if form.name == "stac":
        again = read_format(form, path)
        ours, theirs = (
            pixels_of(GROUND + MIDDLE, one.photos[name], one.camera_of(name))
            for one in (out, again)
        )
        assert np.allclose(ours, theirs, atol=1e-6)


@given(NUMBERS)
@settings(max_examples=50)
def test_distortion_is_undone__law(numbers: Numbers) -> None:
    _, camera = photo_of(numbers)
    ideal = np.array([[0.0, 0.0], [0.4, -0.3], [-0.5, 0.5]])
    assert np.allclose(ideal_from_image(image_from_ideal(ideal, camera), camera), ideal, atol=1e-12)


@pytest.mark.parametrize("bad", [np.inf, np.nan, -1e300])
def test_every_measurement_of_a_point_lies_somewhere__law(bad: float) -> None:
    """Only the last one of each point was looked at."""
    first, *others = (block := block_of((7, 3, 1, False))).measurements
    assert any(one.point_id == first.point_id for one in others)
    spoilt = replace(block, measurements=(replace(first, column=bad), *others))
    form = replace(next(iter(FORMATS.values())), read=lambda _: spoilt)
    with pytest.raises(PhotogrammetryError, match=first.point_id):
        read_format(form, Path("block"))
