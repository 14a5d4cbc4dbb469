"""Orthos of a block on disk: which are made, which stay, which go."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

import app.orthos
from app.orthos import default_gsd_m, make_orthos
from core.orthos.rectification import OrthoProduct
from core.progress import SILENT
from core.raster.dem import level_ground
from core.raster.grid import Grid
from sessions.session import Session
from tests.flights import FlightPlan, fly


def test_orthos_are_as_fine_as_the_scans__truth():
    """15 um at 1 : 15 000 is 22 cm on the ground, and the next round figure 25 cm."""
    flight = fly(FlightPlan(ties=40), np.random.default_rng(0))
    assert default_gsd_m(flight.block) == 0.25


def test_an_ortho_goes_with_its_photo_and_nothing_else_does__law(tmp_path, monkeypatch):
    block = fly(FlightPlan(ties=40), np.random.default_rng(0)).block
    made: list[str] = []

    def rectified(photo, camera, heights, gsd, path, crs, **how):
        made.append(photo.photo_id)
        path.write_bytes(b"pixels")
        return OrthoProduct(photo.photo_id, path, Grid(0, 1, gsd, 1, 1), 1.0, (0.0, 0.0))

    monkeypatch.setattr(app.orthos, "rectify_photo", rectified)
    ground = level_ground(0.0, block.crs)
    monkeypatch.setattr(app.orthos, "chosen_ground", lambda *given: (ground, ()))
    project: Any = SimpleNamespace(
        ortho=SimpleNamespace(gsd_m=1.0), reference=SimpleNamespace(dem=())
    )
    first, *others = block.photos
    fewer = replace(
        block, photos={**block.photos, first: replace(block.photos[first], oriented=False)}
    )
    with Session.open(tmp_path, "ada") as session:
        make_orthos(session, project, block, ground, SILENT)
        folder = session.results / "ortho"
        foreign = folder / "somebodys.tif"
        foreign.write_bytes(b"not ours")
        make_orthos(session, project, fewer, ground, SILENT, only=frozenset(others[:1]))
        assert (folder / f"{first}.tif").is_file(), "the desk makes some anew, and keeps the rest"
        make_orthos(session, project, fewer, ground, SILENT)
        assert {path.stem for path in folder.iterdir()} == {*others, "somebodys"}
        made.clear()
        make_orthos(session, project, block, ground, SILENT)
    assert made == [first]
