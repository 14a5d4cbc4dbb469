"""Tone and place across seams of orthos whose difference was put in."""

import cv2
import numpy as np
import pytest

from core.mosaic.composition import MosaicOptions, compose_mosaic, mosaic_grid
from core.mosaic.seam_fit import fit_seams
from core.raster.grid import Grid
from tests.core.mosaic.conftest import write_ortho


def two_orthos(folder, shift=(0, 0), step=0, noise=2.0, ground=None):
    """The same ground twice, the second so many pixels (right, up) off and brighter."""
    rng = np.random.default_rng(5)
    rough = rng.normal(size=(90, 120))
    fields = np.kron(rough, np.ones((8, 8))) * 20 + rng.normal(size=(720, 960)) * 8 + 110
    ground = fields if ground is None else ground
    grid = Grid.over((1000.0, 2000.0, 1480.0, 2360.0), 0.5)
    right, up = shift
    pictures = (ground, np.roll(ground, (-up, right), (0, 1)) + step)
    orthos = []
    nadirs = ((1100.0, 2180.0), (1380.0, 2180.0))
    for name, picture, nadir in zip("ab", pictures, nadirs, strict=True):
        gray = np.clip(picture + rng.normal(size=picture.shape) * noise, 1, 255).astype(np.uint8)
        orthos.append(write_ortho(folder / f"{name}.tif", name, grid, gray, nadir))
    options = MosaicOptions(balance=False, seams_by_nadir=True)
    made = compose_mosaic(orthos, mosaic_grid(orthos), folder / "m.tif", None, options=options)
    return made, orthos


def test_what_was_put_in_is_found__truth(tmp_path):
    (fit,) = fit_seams(*two_orthos(tmp_path, shift=(4, -3), step=9))
    assert fit.photo_ids == ("a", "b")
    assert fit.length_m == pytest.approx(360, rel=0.05)
    assert fit.matched == fit.places > 20
    assert fit.shift_m == pytest.approx((2.0, -1.5), abs=0.05)
    assert fit.shift_95_m == pytest.approx(2.5, abs=0.1)
    # The shifted ground scatters about the step.
    assert fit.step == pytest.approx(9, abs=1.5)


def test_a_shift_along_a_lone_edge_is_hardly_known__truth(tmp_path):
    """A field's edge that runs north: how far the photos are apart to the north nothing tells."""
    smooth = cv2.GaussianBlur(np.where(np.arange(960) % 40 < 20, 90.0, 140.0)[None], (0, 0), 2)
    ground = np.repeat(smooth, 720, axis=0)
    (fit,) = fit_seams(*two_orthos(tmp_path, shift=(2, 0), noise=6.0, ground=ground))
    assert fit.matched > 20
    assert fit.shift_m[0] == pytest.approx(1.0, abs=0.05)
    known = np.sqrt(np.diagonal(fit.spreads, axis1=1, axis2=2))
    assert np.median(known[:, 0]) < 0.5
    assert np.median(known[:, 1]) > 5 * np.median(known[:, 0])
    away = fit.matches[:, 2:] - (1.0, 0.0)
    assert np.abs(away[:, 1]).max() > 1.0
    squared = np.einsum("ni,nij,nj->n", away, np.linalg.inv(fit.spreads), away)
    # Three sigma in two axes together: one in ninety lies further off.
    assert np.mean(squared < 9.0) > 0.9


def test_photos_that_show_other_things_have_no_shift__truth(tmp_path):
    made, orthos = two_orthos(tmp_path, shift=(300, 200))
    (fit,) = fit_seams(made, orthos)
    assert fit.places > 20
    assert fit.matched == 0
    assert np.isnan(fit.shift_m).all()


def test_a_mosaic_of_one_photo_has_no_neighbours__law(tmp_path):
    made, orthos = two_orthos(tmp_path)
    assert fit_seams(made, orthos[:1]) == ()
