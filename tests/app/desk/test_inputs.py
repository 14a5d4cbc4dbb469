"""What the desk begins with: sizes, orientations and the secret that a page is let in by."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import rasterio
from shapely.geometry import box

from app.desk.inputs import (
    Adjusting,
    first_snapshot,
    first_state,
    last_results,
    ortho_orientations,
    template_m,
)
from app.desk.inputs import desk_inputs as inputs_of
from app.project import read_project
from app.run import PAGE, WRITTEN
from core.adjustment.adjusted import AdjustmentOptions
from core.errors import PhotogrammetryError
from core.localisation.photo_orientation import OrientationOptions
from core.progress import SILENT
from sessions.checks import results_digest
from sessions.decisions import PlacePhoto
from sessions.session import Session
from tests.core.sheets.test_map_sheets import write
from tests.tiny import Tiny
from tests.ui.desk_block import OPTIONS, desk_inputs, tiny_block, tiny_snapshot
from ui.web.access import Door


def test_a_template_is_as_wide_as_its_pixels_on_the_ground__truth():
    block, options = tiny_block().block, OrientationOptions()
    photo = next(iter(block.photos.values()))
    pixel = photo.ground_pixel_m(block.camera_of(photo.photo_id))
    ortho = SimpleNamespace(is_there=True, ground_sample_distance_m=0.5)
    half = template_m(block, ortho, options)
    reduction = max(1, round(max(options.finest_gsd_m, pixel, 0.5) / pixel))
    assert half == pytest.approx(options.template_half_px * reduction * pixel, rel=0.05)
    assert template_m(replace(block, photos={}), ortho, options) == 0
    assert template_m(block, SimpleNamespace(is_there=False), options) == 0


def test_cameras_stay_fixed_where_the_block_says_so__law():
    adjusting = Adjusting(OPTIONS)
    assert adjusting.free == (False, False)
    assert adjusting.choose(cameras=True, robust=True) == (False, True)
    assert adjusting._options == replace(OPTIONS, robust=True)
    free = Adjusting(AdjustmentOptions(estimate_cameras=True))
    free.choose(cameras=False, robust=False)
    assert not free._options.estimate_cameras
    free.choose(cameras=True, robust=False)
    assert free._options.estimate_cameras


def test_what_is_held_is_the_certificate_not_an_estimate__law():
    block = tiny_block().block
    free = Adjusting(AdjustmentOptions(estimate_cameras=True))
    estimated = free(block).block
    assert estimated.cameras != block.cameras
    free.choose(cameras=False, robust=True)
    assert free(estimated).block.cameras == block.cameras


def test_the_chosen_adjustment_is_the_engines__oracle():
    tiny = tiny_block().block
    found = Adjusting(OPTIONS)(tiny)
    assert found.sigma_nought == tiny_snapshot().state.report.sigma_nought


def test_evidence_is_of_the_adjustment_whatever_is_chosen_since__law():
    adjusting = Adjusting(AdjustmentOptions(robust=False))
    report = adjusting(tiny_block().block)
    before = adjusting.evidence(report)
    adjusting._given = AdjustmentOptions(estimate_cameras=True)
    adjusting.choose(cameras=True, robust=True)
    assert adjusting.evidence(report).gains == before.gains


def test_orthos_that_were_kept_remember_their_orientation__law():
    block = tiny_snapshot().state.report.block
    name, other = list(block.photos)[:2]
    photo = block.photos[name]
    exterior = replace(photo.exterior, centre=photo.exterior.centre + np.ones(3))
    kept = (photo.with_exterior(exterior, True), block.camera_of(name))
    latest = Mock(side_effect={f"made-with/{name}": kept}.get)
    session = SimpleNamespace(products=SimpleNamespace(latest_value=latest))
    made = ortho_orientations(session, block)
    assert made[name] is kept
    assert made[other] == (block.photos[other], block.camera_of(other))


def test_the_desk_opens_on_the_block_as_it_was_adjusted__law(tmp_path: Path):
    inputs = desk_inputs(tmp_path)
    state, snapshot = first_state(inputs), first_snapshot(inputs)
    assert state.report is inputs.report
    assert set(state.made) == set(inputs.block.photos)
    assert snapshot.base is inputs.block
    assert set(snapshot.drawn) == set(inputs.block.photos)
    inputs.session.close()


def test_results_are_those_of_the_report_whatever_was_adjusted_since__law(tmp_path: Path):
    report = tiny_snapshot().state.report
    newer = replace(report, sigma_nought=2 * report.sigma_nought)
    with Session.open(tmp_path, "anna") as session:
        session.products.save_value("adjustment", "0" * 64, report)
        assert last_results(session, report.block)[1] == ""
        # Written before its digest was kept.
        (session.results / PAGE).write_text("told")
        assert last_results(session, report.block)[1] == results_digest(report)
        session.products.save_value(WRITTEN, results_digest(report), "")
        session.products.save_value("adjustment", "1" * 64, newer)
        assert last_results(session, report.block)[1] == results_digest(report)


def test_updated_orthos_bring_updated_sheets__truth(tiny_run: Tiny, tmp_path: Path) -> None:
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    mosaic, sheet = folder / "results" / "mosaic.tif", folder / "results" / "sheets" / "west.tif"
    with rasterio.open(mosaic) as file:
        west, south, east, north = (round(edge, -1) for edge in file.bounds)
    middle = (west + east) / 2
    halves = [box(west, south, middle, north), box(middle, south, east, north)]
    write(folder / "klad.gpkg", halves, name=["west", "east"])
    text = (folder / "block.toml").read_text(encoding="utf-8")
    text = text.replace("[ortho]", '[ortho]\nsheets = "klad.gpkg"')
    (folder / "block.toml").write_text(text, encoding="utf-8")
    with Session.open(folder, "anna") as session:
        inputs = inputs_of(read_project(folder), session, "anna", Door())
    report, name = inputs.report, min(inputs.report.block.photos)
    inputs.remake((name,), SILENT, report)
    with Session.open(folder, "anna") as session:
        assert session.products.latest_digest(WRITTEN) == results_digest(report)
    assert np.array_equal(*shown(sheet, mosaic))
    before = sheet.read_bytes()

    photo = report.block.photos[name]
    centre = photo.exterior.centre + np.array([8.0, 0.0, 0.0])
    moved = replace(photo, exterior=replace(photo.exterior, centre=centre))
    block = report.block.with_photos({**report.block.photos, name: moved})
    inputs.remake((name,), SILENT, replace(report, block=block))
    assert sheet.read_bytes() != before
    assert np.array_equal(*shown(sheet, mosaic))

    (folder / "klad.gpkg").unlink()
    made = mosaic.stat().st_mtime_ns
    with pytest.raises(PhotogrammetryError, match="klad"):
        inputs.remake((name,), SILENT, report)
    assert mosaic.stat().st_mtime_ns == made


def test_boxes_and_protocol_tell_what_the_desk_adjusts_with__truth(
    tiny_run: Tiny, tmp_path: Path
) -> None:
    """Both boxes stood ticked whatever block.toml says, and so said the protocol of an update."""
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    file = folder / "block.toml"
    given = file.read_text(encoding="utf-8")
    file.write_text(f'{given}\n[adjustment]\ncameras = false\ngross_errors = "none"\n', "utf-8")
    with Session.open(folder, "anna") as session:
        fixed = inputs_of(read_project(folder), session, "anna", Door())
        assert first_state(fixed).free == (False, False)
        file.write_text(given, encoding="utf-8")
        inputs = inputs_of(read_project(folder), session, "anna", Door())
    assert first_state(inputs).free == (True, True)
    assert inputs.choose is not None
    inputs.choose(False, True)
    inputs.remake((), SILENT, inputs.adjust(inputs.block, SILENT))
    said = json.loads((folder / "results" / "adjustment.json").read_text(encoding="utf-8"))
    assert said["options"]["cameras_estimated"] is False


def test_the_scene_stays_on_its_ground_when_a_photo_is_placed__truth(tiny_run: Tiny) -> None:
    """Points and photos were drawn beside the terrain, by a share of what the photo was moved."""
    name = tiny_run.names[0]
    columns, rows = 200.0, 200.0
    pairs = ((40.0, 40.0), (columns, 40.0), (columns, rows), (40.0, rows))
    with Session.open(tiny_run.folder, "anna") as session:
        inputs = inputs_of(read_project(tiny_run.folder), session, "anna", Door())
        photo, camera = inputs.block.photos[name], inputs.block.camera_of(name)
        ground = photo.object_from_pixel(np.array(pairs), np.full(4, 280.0), camera)[:, :2] + 3000
        clicks = tuple(
            (*pixel, *place) for pixel, place in zip(pairs, ground.tolist(), strict=True)
        )
        session.record(PlacePhoto(name, clicks))
        placed = session.replayed(inputs.block, inputs.initial.films, inputs.initial.cameras)
        session.undo()
    moved = placed.photos[name].approximate.centre - photo.approximate.centre
    assert np.hypot(*moved[:2]) > 2000
    assert np.array_equal(placed.origin, inputs.block.origin)


def shown(sheet: Path, mosaic: Path) -> tuple[np.ndarray, np.ndarray]:
    """A sheet, and the mosaic in the same place."""
    with rasterio.open(sheet) as one, rasterio.open(mosaic) as other:
        size = other.res[0]
        left = round((one.bounds.left - other.bounds.left) / size)
        top = round((other.bounds.top - one.bounds.top) / size)
        wide = np.pad(other.read(1), 20)
        return one.read(1), wide[top + 20 :, left + 20 :][: one.height, : one.width]
