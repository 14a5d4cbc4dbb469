"""Where the ground has changed: put in by halves, found by cells."""

import cv2
import numpy as np
import pyogrio
import pytest
import rasterio
from affine import Affine

from core.mosaic.change import DIFFERENT, SAME, find_change, write_change
from core.raster.ortho import open_ortho

CRS = "EPSG:5514"
WEST, NORTH, SIDE = -584_000.0, -1_196_000.0, 1024


def fields(seed):
    """Ground in patches about random places: edges in all directions."""
    rng = np.random.default_rng(seed)
    apart = np.full((SIDE, SIDE), 255, np.uint8)
    apart[tuple(rng.integers(0, SIDE, (2, 1000)))] = 0
    labels = cv2.distanceTransformWithLabels(apart, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[
        1
    ]
    return rng.uniform(60, 200, labels.max() + 1)[labels].astype(np.float32)


def ortho(folder, name, ground, rng, noise=12.0, known=slice(None)):
    values = np.zeros((SIDE, SIDE))
    values[:, known] = (ground + rng.normal(size=ground.shape) * noise)[:, known]
    path = folder / f"{name}.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=SIDE, height=SIDE, count=1, dtype="uint8", crs=CRS,
        nodata=0, transform=Affine(1.0, 0.0, WEST, 0.0, -1.0, NORTH),
    ) as file:  # fmt: skip
        file.write(np.clip(np.rint(values), 0, 255).astype(np.uint8), 1)
    return open_ortho([path], CRS)


BOUNDS = (WEST, NORTH - SIDE, WEST + SIDE, NORTH)


@pytest.fixture(scope="module")
def halves(tmp_path_factory):
    """The west as it was, in other light and a pixel aside; the east new."""
    folder, rng = tmp_path_factory.mktemp("change"), np.random.default_rng(5)
    then, other = fields(1), fields(2)
    now = 255 - 0.8 * np.roll(then, (1, -1), (0, 1))
    now[:, SIDE // 2 :] = other[:, SIDE // 2 :]
    return find_change(ortho(folder, "then", then, rng), ortho(folder, "now", now, rng), BOUNDS)


def test_the_half_that_changed_is_found__truth(halves):
    middle = halves.grid.columns // 2
    west, east = halves.state[1:-1, 1 : middle - 1], halves.state[1:-1, middle + 1 : -1]
    assert (west == SAME).mean() > 0.95
    assert (west == DIFFERENT).mean() < 0.01
    assert (east == DIFFERENT).mean() > 0.7
    assert (east == SAME).mean() < 0.05
    assert halves.shares["same"] == pytest.approx(0.5, abs=0.1)


def test_blank_and_unseen_ground_is_not_judged__truth(tmp_path):
    rng = np.random.default_rng(6)
    then = fields(3)
    then[: SIDE // 2] = 120.0
    found = find_change(
        ortho(tmp_path, "then", then, rng, 2.0),
        ortho(tmp_path, "now", fields(3), rng, 2.0, known=slice(0, 512)),
        BOUNDS,
    )
    assert found.seen.mean() == pytest.approx(0.5, abs=0.05)
    assert (found.state[:7] == 0).mean() > 0.9
    assert (found.state[9:, :7] == SAME).mean() > 0.95


def test_the_layers_hold_the_cells__law(halves, tmp_path):
    path = tmp_path / "change.gpkg"
    write_change(halves, path, CRS)
    assert pyogrio.list_layers(path)[:, 0].tolist() == ["different", "same"]
    for layer, value in (("different", DIFFERENT), ("same", SAME)):
        meta, _, _, (area,) = pyogrio.raw.read(path, layer=layer)
        assert meta["crs"] == CRS
        cells = (halves.state[halves.seen] == value).sum()
        assert area.sum() == pytest.approx(cells * halves.grid.ground_sample_distance_m**2)
