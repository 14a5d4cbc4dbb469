"""The session file stays a GeoPackage that QGIS opens, while the desk runs and after."""

from pathlib import Path

import pyogrio
import shapely

from app.desk.wiring import open_desk
from core.block import Block
from sessions.session import FILE
from tests.ui.desk_block import desk_inputs, tiny_block
from ui.review.gestures import Judged
from ui.review.state import DeskState

LAYERS = {"photos", "footprints", "points", "measurements", "residual_vectors"}


def looked_into(path: Path, block: Block) -> int:
    """Open every layer as QGIS does; the number of decisions told."""
    listed = dict(pyogrio.list_layers(path).tolist())
    assert set(listed) >= {*LAYERS, "decisions"}
    for name in LAYERS:
        told = pyogrio.read_info(path, layer=name, force_feature_count=True)
        assert told["crs"] == block.crs
        assert told["features"] > 0
        assert len(told["fields"]) > 2
    return int(pyogrio.read_info(path, layer="decisions", force_feature_count=True)["features"])


def test_all_layers_are_listed_while_and_after_the_desk_runs__oracle(tmp_path):
    inputs = desk_inputs(tmp_path)
    block, path = tiny_block().block, tmp_path / FILE
    polygons = {name: shapely.box(0, 0, 1, 1) for name in block.photos}
    inputs.session.write_layers(block, inputs.report, polygons)
    state = DeskState(block, inputs.report, made={})
    keys = list(state.block.measurements)[:5]
    with open_desk(inputs) as desk:
        assert looked_into(path, block) == 0
        for key in keys:
            desk.loop.submit(Judged("anna-seat", key, "dubious"))
        desk.loop.close()
        assert looked_into(path, block) == len(keys)
    inputs.session.close()
    assert looked_into(path, block) == len(keys)
