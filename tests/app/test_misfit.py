"""The misfit of a mosaic is told of that mosaic alone, and is a table of every vector."""

import csv
import json
from dataclasses import replace
from pathlib import Path

from app.misfit import COLUMNS, PLACES, PRODUCT, TABLE, known_places, misfit_rows
from sessions.checks import version_on_disk
from sessions.products import Products, digest_of
from sessions.session import Session
from tests.tiny import Tiny


def test_places_are_those_of_the_mosaic_on_disk__law(tiny_run: Tiny, tmp_path: Path) -> None:
    with Session.open(tiny_run.folder, "ada") as session:
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


def test_the_report_has_every_likely_fault_worst_first__law(tiny_run: Tiny) -> None:
    with Session.open(tiny_run.folder, "ada") as session:
        _, places = session.products.latest_value(PLACES)
    figures = json.loads((tiny_run.folder / "results/report.json").read_text(encoding="utf-8"))
    told = [(one["kind"], *one["position"]) for one in figures["likely_faults"]]
    assert told == [(place.kind, place.east, place.north) for place in places] != []
