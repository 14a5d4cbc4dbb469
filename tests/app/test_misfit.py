"""The misfit of a mosaic is told of that mosaic alone, and is a table of every vector."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from app.cli import DONE, main
from app.misfit import COLUMNS, PLACES, PRODUCT, TABLE, known_places, level_sigma_m, misfit_rows
from core.geometry.robust import robust_sigma
from core.mosaic.misfit import CONTROL_RULE
from core.raster.dem import level_ground
from sessions.checks import version_on_disk
from sessions.decisions import Place
from sessions.products import Products, digest_of
from sessions.session import Session
from tests.tiny import Tiny


@pytest.fixture(scope="module")
def shifted(tiny_run: Tiny, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One photo drawn off the reference: somebody placed its control six pixels too far right."""
    folder = tmp_path_factory.mktemp("shifted") / "block"
    shutil.copytree(tiny_run.folder, folder)
    with Session.open(folder, "ada") as session:
        block = session.products.latest_value("adjustment").block
        for point, photo in block.measurements:
            one = block.measurements[point, photo]
            if photo == tiny_run.names[0] and one.used and block.surveyed[point].role == "control":
                session.record(Place(point, photo, one.column + 6.0, one.row))
    assert main(["report", str(folder)]) == DONE
    return folder


def test_places_are_those_of_the_mosaic_on_disk__law(shifted: Path, tmp_path: Path) -> None:
    with Session.open(shifted, "ada") as session:
        mosaic = session.products.latest_value("mosaic")
        _, places = session.products.latest_value(PLACES)
        assert len(known_places(session.products)) == len(places) > 0
    first, *rest = mosaic.seams
    moved = replace(mosaic, seams=(replace(first, area=first.area.buffer(-5)), *rest))
    products = Products(tmp_path)
    assert known_places(products) == ()
    products.save_value("mosaic", digest_of("first"), mosaic)
    products.save_value(PLACES, digest_of("first"), (version_on_disk(products), places))
    assert [place.east for place in known_places(products)] == [place.east for place in places]
    products.save_value("mosaic", digest_of("second"), moved)
    assert known_places(products) == ()


def test_the_table_has_a_row_for_every_vector__law(tiny_run: Tiny) -> None:
    with Session.open(tiny_run.folder, "ada") as session:
        _, misfit = session.products.latest_value(PRODUCT)
    rows = misfit_rows(misfit)
    assert len(rows) == len(misfit.vectors.positions) > 50
    with (tiny_run.folder / "results" / TABLE).open(encoding="utf-8") as file:
        heads, *told = csv.reader(file)
    assert heads == COLUMNS.split(",")
    assert [tuple(row) for row in told] == rows


def test_level_ground_is_as_far_off_as_the_terrain_is_hilly__truth(tiny_run: Tiny) -> None:
    with Session.open(tiny_run.folder, "ada") as session:
        report = session.products.latest_value("adjustment")
    ties = report.tie_positions[np.isfinite(report.tie_positions).all(axis=1)]
    true = tiny_run.truth.heights_at(ties)
    level = level_ground(float(np.mean(true)), "EPSG:5514")
    told = level_sigma_m(report, level)
    assert told == pytest.approx(robust_sigma(true - np.mean(true)), rel=0.2)


def test_the_report_has_every_likely_fault_worst_first__law(shifted: Path) -> None:
    with Session.open(shifted, "ada") as session:
        _, places = session.products.latest_value(PLACES)
    figures = json.loads((shifted / "results/report.json").read_text(encoding="utf-8"))
    told = [(one["kind"], *one["position"]) for one in figures["likely_faults"]]
    assert told == [(place.kind, place.east, place.north) for place in places] != []


def test_the_mosaic_is_compared_with_further_references__truth(tiny_run: Tiny, tmp_path: Path):
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    away = folder / "away.tif"
    with rasterio.open(tiny_run.truth.archival_ortho) as file:
        profile, moved = file.profile, Affine.translation(90_000, 0) @ file.transform
        with rasterio.open(away, "w", **{**profile, "transform": moved}) as other:
            other.write(file.read())
    with (folder / "block.toml").open("a", encoding="utf-8") as text:
        archival = tiny_run.truth.archival_ortho.relative_to(tiny_run.folder).as_posix()
        text.write(f'[[reference.other]]\northo = "{archival}"\nyear = 1938\northo_sigma_m = 0.1\n')
        text.write('[[reference.other]]\northo = "away.tif"\n')
        text.write('[[reference.other]]\northo = "ortho/*.tif"\n')
        text.write("year = 2022\northo_sigma_m = 0.25\n")
    assert main(["report", str(folder)]) == DONE
    figures = json.loads((folder / "results/report.json").read_text(encoding="utf-8"))
    compared, today = figures["comparisons"]
    assert compared["name"] == f"{archival} (1938)"
    assert (compared["count"] > 50, compared["truth_sigma_m"]) == (True, 0.1)
    assert compared["m_p"] < 2
    # Decades later little looks alike by gray values: as control is searched, the ground is found.
    assert today["rule"] == CONTROL_RULE
    own = figures["misfit"]
    assert today["count"] + today["refused"].get("mismatch", 0) == own["count"] > 20
    assert today["median_shift"] == pytest.approx(own["median_m"], abs=0.3)
    told = [one["message"] for one in figures["doubts"] if one["subject"] == "away.tif"]
    assert len(told) == 1
    assert "no area in common" in told[0]
