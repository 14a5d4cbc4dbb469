"""Tie points of real blocks, judged by true or published orientations."""

import numpy as np
import pytest

from core.block import ground_of
from core.ties.chains import rays_per_point
from core.ties.thinning import frame_cells
from tests.core.ties.judging import intersected, match_ties, sigma_nought
from tests.core.ties.ngi import ngi_block
from tests.core.ties.vovcha import true_block, vovcha_block

pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")


@pytest.fixture(scope="module")
def vovcha(shared_data):
    folder = shared_data / "vovcha-film"
    block = vovcha_block(folder)
    ties, reports, doubts = match_ties(block, rng=np.random.default_rng(1))
    return true_block(folder, block), ties, reports, doubts


def test_vovcha_rays_lie_as_the_truth_demands__real(vovcha):
    true, ties, _, _ = vovcha
    _, residual = intersected(true, ties)
    length = np.linalg.norm(residual, axis=1)
    # 0.022 px and 0.15 px at the time of writing; the ground was rendered, without grain in common.
    assert np.sqrt(np.mean(residual**2)) < 0.05
    assert np.mean(length < 2.0) > 0.99
    assert 0.75 < sigma_nought(ties, residual) < 1.2


def test_vovcha_photos_are_tied_all_over__real(vovcha):
    true, ties, reports, doubts = vovcha
    assert all(np.sum(ties.photo == number) >= 150 for number in range(6))
    # Four photos meet only in the corners: forward overlap is 27 %, side overlap 33 %.
    assert np.sum(rays_per_point(ties) >= 3) >= 90
    assert all(report.tied and report.ties >= 30 for report in reports)
    assert not doubts
    area = frame_cells(true, ties, 3)
    for number, name in enumerate(ties.photo_ids):
        count = np.bincount(area[ties.photo == number], minlength=9)
        assert (count[shared_areas(true, name)] >= 3).all(), (name, count)


def shared_areas(block, name: str) -> np.ndarray:
    """Gruber areas of a photo of which another photo sees a tenth or more."""
    photo, camera = block.photos[name], block.camera_of(name)
    line = np.linspace(-86, 86, 43)
    film = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    ground = ground_of(photo, camera, photo.interior.pixel_from_film(film))
    seen = np.zeros(len(film), dtype=bool)
    for other, another in block.photos.items():
        if other != name:
            there = another.interior.film_from_pixel(another.pixel_from_object(ground, camera))
            seen |= np.all(np.abs(there) < 86, axis=1)
    area = np.floor((film * [1, -1] + 90) / 60).astype(int)
    cell = area[:, 1] * 3 + area[:, 0]
    share = np.bincount(cell, seen, minlength=9) / np.bincount(cell, minlength=9)
    return share >= 0.1


def test_ngi_rays_lie_as_published_orientations_demand__real(shared_data):
    given, published = ngi_block(shared_data / "ngi-baviaanskloof")
    ties, reports, doubts = match_ties(given, rng=np.random.default_rng(1))
    _, residual = intersected(published, ties)
    length = np.linalg.norm(residual, axis=1)
    # 0.10 px at the time of writing, published orientations included.
    assert np.sqrt(np.mean(residual**2)) < 0.2
    assert np.mean(length < 2.0) > 0.99
    assert sigma_nought(ties, residual) < 1.8
    assert all(np.sum(ties.photo == number) >= 150 for number in range(4))
    assert len([report for report in reports if report.tied]) == 6
    assert not [doubt for doubt in doubts if doubt.gravity >= 0.5]
