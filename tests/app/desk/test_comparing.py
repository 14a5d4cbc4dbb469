"""What a photo shows is found in the others."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.desk.comparing import Transferring
from app.desk.measuring import Errors
from core.adjustment.adjusted import ExteriorSigmas
from core.block import Measurement
from core.matching.reference import usual_sigmas_m
from core.raster.scan_file import open_scan
from tests.core.ties.rendered import rendered_block, terrain


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_what_one_photo_shows_is_found_in_the_others__truth(tmp_path: Path):
    _, block = rendered_block(tmp_path, 0.0)
    photos = {
        name: photo.with_exterior(photo.exterior, oriented=True)
        for name, photo in block.photos.items()
    }
    block = block.with_photos(photos)
    place = np.array([[700.0, 700.0, float(terrain(700.0, 700.0, 0.0))]])
    places = {
        name: photo.pixel_from_object(place, block.camera_of(name))[0]
        for name, photo in block.photos.items()
    }
    first = next(iter(places))
    measured = [Measurement("P", first, *places[first].tolist(), 0.3, status="accepted")]
    level = SimpleNamespace(heights=lambda plane: terrain(plane[:, 0], plane[:, 1], 0.0))
    sigmas = {name: ExteriorSigmas(np.full(3, 0.5), np.full(3, 3e-4)) for name in block.photos}
    errors = Errors(sigmas)
    reference = SimpleNamespace(
        ortho=SimpleNamespace(is_there=False), dem=level, sigmas_m=usual_sigmas_m
    )
    finder = Transferring(reference, open_scan)
    found = finder.proposals(block, errors, "P", measured)
    assert len(found) >= 1
    for item in found:
        assert np.hypot(*(item.pixel[0] - places[item.photo_id])) < 1.0
        assert item.score > 0.5
    assert finder.proposals(block, errors, "P", []) == ()
