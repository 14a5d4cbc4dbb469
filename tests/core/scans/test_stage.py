"""All scans of a block at once; a broken one does not stop the others."""

import numpy as np
import pytest
from PIL import Image

from core.errors import PhotogrammetryError
from core.geometry.camera import Camera
from core.progress import Work
from core.scans.stage import ScanInput, orient_scans


def test_scans_are_oriented_to_their_film__truth(tiny, scan_set):
    assert list(scan_set.oriented) == tiny.names
    assert not scan_set.set_aside
    for name, scan in scan_set.oriented.items():
        true = tiny.truth.photos[name]
        film = np.array([[-60.0, -60.0], [60.0, -60.0], [0.0, 0.0], [55.0, 60.0]])
        found = scan.interior.pixel_from_film(film)
        assert np.abs(found - true.pixels(film)).max() < 0.3


def test_a_scan_that_cannot_be_read_is_set_aside__truth(given, tmp_path):
    broken = tmp_path / "broken.tif"
    broken.write_bytes(b"II*\x00 no more than this")
    mixed = (given.scans[0], ScanInput(broken, "archive", 180.0))
    found = orient_scans(mixed, given.cameras, Work())
    assert list(found.oriented) == [given.scans[0].path.stem]
    assert list(found.set_aside) == ["broken"]
    assert [doubt.subject for doubt in found.doubts if doubt.kind == "scan-set-aside"] == ["broken"]
    with pytest.raises(PhotogrammetryError, match="broken"):
        orient_scans(mixed[1:], given.cameras, Work())


def test_a_digital_frame_is_taken_as_it_is__law(tmp_path):
    """What looks like border and marks in it is picture; the sensor's pixels are known."""
    picture = np.random.default_rng(8).integers(40, 220, (600, 800)).astype(np.uint8)
    picture[:60] = picture[-60:] = picture[:, :60] = picture[:, -60:] = 0
    for row, column in ((30, 30), (30, 770), (570, 30), (570, 770)):
        picture[row - 6 : row + 7, column - 6 : column + 7] = 255
    file = tmp_path / "frame.png"
    Image.fromarray(picture).save(file)
    camera = Camera("sensor", 50.0, (40.0, 30.0), (0.3, -0.2), digital=True)
    found = orient_scans((ScanInput(file, "sensor", 50.0),), {"sensor": camera}, Work())
    scan = found.oriented["frame"]
    assert not found.doubts
    assert not scan.fiducials
    corners = scan.interior.pixel_from_film(camera.frame_corners_mm)
    assert np.allclose(corners, [[0, 600], [800, 600], [800, 0], [0, 0]], atol=1e-9)
