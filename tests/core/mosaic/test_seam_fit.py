"""Tone and place across seams of orthos whose difference was put in."""

import numpy as np
import pytest

from core.mosaic.composition import MosaicOptions, compose_mosaic, mosaic_grid
from core.mosaic.seam_fit import fit_seams
from core.raster.grid import Grid
from tests.core.mosaic.conftest import write_ortho


def two_orthos(folder, shift=(0, 0), step=0, noise=2.0):
    """The same ground twice, the second so many pixels (right, up) off and brighter."""
    rng = np.random.default_rng(5)
    rough = rng.normal(size=(90, 120))
    ground = np.kron(rough, np.ones((8, 8))) * 20 + rng.normal(size=(720, 960)) * 8 + 110
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


def test_photos_that_show_other_things_have_no_shift__truth(tmp_path):
    made, orthos = two_orthos(tmp_path, shift=(300, 200))
    (fit,) = fit_seams(made, orthos)
    assert fit.places > 20
    assert fit.matched == 0
    assert np.isnan(fit.shift_m).all()


def test_a_mosaic_of_one_photo_has_no_neighbours__law(tmp_path):
    made, orthos = two_orthos(tmp_path)
    assert fit_seams(made, orthos[:1]) == ()
