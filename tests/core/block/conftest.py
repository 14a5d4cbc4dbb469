"""What the tests of the block share: the reference points of the tiny block."""

import pytest

from core.block.registration.reference_points import ReferenceFeatures, gather_reference_points
from core.progress import Silent
from core.reference.junctions import find_junctions
from core.reference.planar import planar_graph
from core.reference.roads import read_roads
from core.synthetic.orthos import CRS
from tests.tiny import Tiny


@pytest.fixture(scope="session")
def junctions(tiny: Tiny):
    """Road junctions of the tiny block."""
    files = sorted((tiny.folder / "roads").glob("*.shp"))
    bounds = tiny.reference.dem.bounds
    return find_junctions(planar_graph(read_roads(files, CRS, bounds)), tiny.reference.dem)


@pytest.fixture(scope="session")
def features(tiny: Tiny, junctions) -> ReferenceFeatures:
    """Junctions and salient points of the tiny block."""
    opened = tiny.opened(tiny.names[0])
    return gather_reference_points(
        tiny.reference,
        junctions,
        tiny.reference.ortho.bounds,
        opened.width_m,
        opened.ground_pixel_m,
        None,
        Silent(),
    )
