"""Result tables as scripts outside the project read them."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from app.report.tables import control_rows, write_results, write_table
from core.adjustment.adjusted import NewPoint


@pytest.fixture(scope="module")
def tables(report, tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    paths = write_results(folder, report)
    assert sorted(p.name for p in folder.iterdir()) == sorted(p.name for p in paths)
    return {path.stem: read(path) for path in paths}


def read(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


COLUMNS = {
    "control_points": "point_id,scan,col,row,X,Y,Z,role,status,score,residual_col,residual_row,"
    "sigma_px,reason",
    "check_points": "point_id,X,Y,Z,dX,dY,dZ,used_scans",
    "exterior_orientation": "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg,sigma_X,sigma_Y,sigma_Z,"
    "sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg",
    "tie_points": "point_id,X,Y,Z,sigma_X,sigma_Y,sigma_Z,rays,max_residual_px",
}


@pytest.mark.parametrize("name", COLUMNS)
def test_columns_are_those_of_the_contract__law(tables, name):
    assert ",".join(tables[name][0]) == COLUMNS[name]


def test_points_from_photos_have_a_table__law(report, tmp_path):
    place, sigma = np.array([500.0, 600.0, 310.0]), np.array([0.1, 0.2, 0.4])
    write_results(tmp_path, replace(report, new_points=(NewPoint("N001", place, sigma, 3, 0.7),)))
    header, row = (tmp_path / "points_from_photos.csv").read_text(encoding="utf-8").splitlines()
    assert header == COLUMNS["tie_points"]
    assert row == "N001,500.0000,600.0000,310.0000,0.1000,0.2000,0.4000,3,0.7000"


def test_control_rows_say_what_became_of_each_measurement__law(tables, report):
    rows = tables["control_points"]
    assert len(rows) == len(report.block.measurements)
    assert {row["status"] for row in rows} == {"auto", "accepted", "rejected", "dubious", "unused"}
    assert {row["role"] for row in rows} == {"control", "check"}
    for row in rows:
        key = (row["point_id"], row["scan"])
        measurement = report.block.measurements[key]
        assert float(row["col"]) == pytest.approx(measurement.column, abs=1e-4)
        assert float(row["residual_row"]) == pytest.approx(report.residuals_px[key][1], abs=1e-4)
        assert row["reason"] == (report.rejected.get(key) or measurement.reason)


def test_points_from_photos_are_no_control__law(report):
    block = report.block
    name = next(iter(block.measurements))[0]
    surveyed = {**block.surveyed, name: replace(block.surveyed[name], role="new")}
    rows = control_rows(replace(report, block=replace(block, surveyed=surveyed)))
    assert {row[0] for row in rows} == {key[0] for key in block.measurements} - {name}


def test_what_a_photo_shows_that_takes_no_part_is_unused__law(report):
    block = report.block
    point, name = next(key for key, m in block.measurements.items() if m.status == "auto")
    aside = block.with_photos({**block.photos, name: replace(block.photos[name], oriented=False)})
    rows = control_rows(replace(report, block=aside))
    (row,) = [row for row in rows if row[:2] == [point, name]]
    assert (row[8], row[-1]) == ("unused", "The photo takes no part in the adjustment.")


def test_orientations_are_read_back_as_they_were__law(tables, report):
    for row in tables["exterior_orientation"]:
        exterior = report.block.photos[row["scan"]].exterior
        assert float(row["X"]) == pytest.approx(exterior.centre[0], abs=1e-4)
        assert np.radians(float(row["phi_deg"])) == pytest.approx(exterior.phi, abs=1e-9)
        sigma = report.exterior_sigmas[row["scan"]].angles[2]
        assert np.radians(float(row["sigma_kappa_deg"])) == pytest.approx(sigma, abs=1e-9)


def test_film_is_computed_from_the_interior_table__law(tables, report):
    for row in tables["interior_orientation"]:
        interior = report.block.photos[row["scan"]].interior
        column, line = 1234.5, 9876.5
        x = float(row["x_0"]) + float(row["x_col"]) * column + float(row["x_row"]) * line
        y = float(row["y_0"]) + float(row["y_col"]) * column + float(row["y_row"]) * line
        film = interior.film_from_pixel(np.array([[column, line]]))[0]
        assert (x, y) == pytest.approx(film.tolist(), abs=1e-4)
        assert float(row["residual_3_y_um"]) == pytest.approx(interior.residuals_um[2, 1], abs=0.01)


def test_tie_table_holds_what_took_part__law(tables, report):
    rows = tables["tie_points"]
    in_use = np.isfinite(report.tie_residuals_px).all(axis=1)
    assert sum(int(row["rays"]) for row in rows) <= in_use.sum()
    assert len(rows) > 200
    assert max(float(row["max_residual_px"]) for row in rows) == pytest.approx(
        np.linalg.norm(report.tie_residuals_px[in_use], axis=1).max(), abs=1e-3
    )


def test_checks_are_computed_minus_known__law(tables, report):
    assert len(tables["check_points"]) == len(report.checks) > 5
    for row, check in zip(tables["check_points"], report.checks, strict=True):
        known = report.block.surveyed[row["point_id"]].position
        assert float(row["X"]) == pytest.approx(known[0], abs=1e-4)
        assert float(row["dY"]) == pytest.approx(check.difference_m[1], abs=1e-4)


def test_photo_without_sigmas_has_empty_cells__law(report, tmp_path):
    bare = replace(report, exterior_sigmas={}, checks=())
    write_results(tmp_path, bare)
    rows = read(tmp_path / "exterior_orientation.csv")
    assert all(row["sigma_X"] == "" for row in rows)
    text = (tmp_path / "check_points.csv").read_text(encoding="utf-8")
    assert text == "point_id,X,Y,Z,dX,dY,dZ,used_scans\n"


def test_no_cell_of_a_table_is_run__truth(tmp_path):
    write_table(tmp_path / "t.csv", "point_id,X", [['=HYPERLINK("a")', -1.5], ["-12", None]])
    with (tmp_path / "t.csv").open(newline="") as stream:
        assert list(csv.reader(stream))[1:] == [['\'=HYPERLINK("a")', "-1.5"], ["-12", ""]]
