"""What the tests of core share: reference points of the tiny block, a scene, a texture."""

import numpy as np
import pytest

from app.project import described, read_project
from core.formats.roads import read_roads
from core.georeference.stage import Georeferenced
from core.progress import Silent, Work
from core.reference.junctions import find_junctions
from core.reference.road_graph import planar_graph
from core.reference.stage import ReferenceFeatures, gather_reference_points
from core.results import BlockInput
from core.scans.stage import ScanSet, orient_scans
from core.synthetic.options import CRS
from tests.core.georeference.placing import georeference
from tests.core.raster_files import smooth_picture
from tests.core.scene import ground, middle, scene
from tests.tiny import Tiny

__all__ = ["ground", "middle", "scene"]


@pytest.fixture(scope="session")
def junctions(tiny: Tiny):
    """Road junctions of the tiny block."""
    files = sorted((tiny.folder / "roads").glob("*.shp"))
    bounds = tiny.reference.dem.bounds
    return find_junctions(
        planar_graph(read_roads(files, CRS, bounds)),
        tiny.reference.dem,
        sigmas_m=tiny.reference.sigmas_m,
    )


@pytest.fixture(scope="session")
def features(tiny: Tiny, junctions) -> ReferenceFeatures:
    """Junctions and salient points of the tiny block."""
    opened = tiny.opened(tiny.names[0])
    return gather_reference_points(
        tiny.reference,
        junctions,
        tiny.reference.ortho.bounds,
        opened.width_m,
        gsd_m=opened.ground_pixel_m,
        mask=None,
        progress=Silent(),
    )


@pytest.fixture
def texture() -> np.ndarray:
    return smooth_picture(300, 400).astype(np.uint8)[0]


@pytest.fixture(scope="session")
def given(tiny_block) -> BlockInput:
    """The tiny block as its owner describes it."""
    return described(read_project(tiny_block))


@pytest.fixture(scope="session")
def scan_set(given) -> ScanSet:
    """Its scans with their interior orientation."""
    return orient_scans(given.scans, given.cameras, Work())


@pytest.fixture(scope="session")
def placed(given, scan_set) -> Georeferenced:
    """Its photos where their world files put them."""
    return georeference(given, scan_set)
