"""Addis Ababa 2002 from its published lists alone, with the commands that a user types."""

from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.formats.eo_list import read_eo_list
from tests.real.readers import ADDIS, ADDIS_SIGMA_PX, read_addis, read_addis_orientation

BLOCK = """
[block]
name = "addis"
crs = "EPSG:20137"
corrections = []

[camera.film]
principal_distance_mm = {distance}
principal_point_mm = {point}
frame_mm = [230.0, 230.0]
fiducials_mm = {{ {marks} }}

[scans]
files = "*.tif"
camera = "film"
scan_pixel_um = 25
georeference = "none"
scale_number = {scale}

[adjustment]
cameras = false
gross_errors = "none"
"""
"""What a user fills in: camera certificate and scale; ERDAS corrected neither refraction nor
curvature, held the camera, and searched no gross errors."""
SCALE_NUMBER = 6400
"""Flying 980 m above ground."""
FIXED = ("--answer", "sigma_xy=0.001", "--answer", "sigma_Z=0.001")
"""ERDAS held the control points; a millimetre is as good."""


def gruber(*words: object) -> None:
    assert main([str(word) for word in words]) == 0, words


def filled_in(lists: Path) -> str:
    camera = next(iter(read_addis(lists).cameras.values()))
    marks = ", ".join(f"{name} = {list(place)}" for name, place in camera.fiducials_mm.items())
    return BLOCK.format(
        distance=camera.principal_distance_mm,
        point=list(camera.principal_point_mm),
        marks=marks,
        scale=SCALE_NUMBER,
    )


@pytest.fixture(scope="module")
def block(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Everything brought in by commands; no orientation is given to begin from."""
    lists, block = shared_data / ADDIS, tmp_path_factory.mktemp("addis") / "addis"
    gruber("new", block, "--without-pictures", lists / "eo.csv")
    (block / "block.toml").write_text(filled_in(lists), encoding="utf-8")
    points, refused = lists / "ground_points.csv", ("--answer", "refused=leave out")
    gruber("import", block, "--from", "points", points, *refused, *FIXED)
    gruber("import", block, "--from", "measurements", lists / "fiducials_px.csv")
    weight = ("--answer", f"sigma={ADDIS_SIGMA_PX}")
    gruber("import", block, "--from", "measurements", lists / "image_points.csv", *weight)
    gruber("run", block)
    gruber("export", block, "--to", "eo", "--out", block / "adjusted.csv")
    return block


def test_centres_are_those_of_erdas__real(block: Path, shared_data: Path) -> None:
    published, ours = (
        read_addis_orientation(shared_data / ADDIS),
        read_eo_list(block / "adjusted.csv"),
    )
    for name, known in published.items():
        # Measured: 6.3 mm at most, as by the adjustment alone; ERDAS stopped at 0.001 m.
        assert np.abs(np.array(ours[name].centre) - known.centre).max() < 0.010
        # 1 cm at 1000 m flying height is 1e-5 rad.
        assert np.allclose(ours[name].angles, known.angles, atol=1e-5)


def test_tables_are_written_and_orthos_are_not__real(block: Path) -> None:
    results = {path.name for path in (block / "results").iterdir()}
    assert {"exterior_orientation.csv", "tie_points.csv", "adjustment.txt"} <= results
    assert not {"ortho", "mosaic.tif", "report.html"} & results


def test_orthos_are_refused_in_words__real(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(block)]) != 0
    assert "stand-ins without pictures" in capsys.readouterr().err


def test_measurements_go_out_and_come_in_again__real(block: Path) -> None:
    first, again = block / "measured.csv", block / "again.csv"
    gruber("export", block, "--to", "measurements", "--out", first)
    gruber("import", block, "--from", "measurements", first)
    gruber("export", block, "--to", "measurements", "--out", again)
    assert sorted(places(first)) == pytest.approx(sorted(places(again)), abs=1e-9)


def places(path: Path) -> list[float]:
    rows = [row.split(",") for row in path.read_text().splitlines()[1:]]
    return [float(cell) for row in rows for cell in row[2:]]


def test_orientations_come_in_by_their_columns__real(block: Path, shared_data: Path) -> None:
    heads = "scan,,,,,,,,,X,Y,Z,omega_rad,phi_rad,kappa_rad"
    table = shared_data / ADDIS / "eo.csv"
    gruber("import", block, "--from", "eo", table, "--answer", f"columns={heads}")
    brought = read_eo_list(block / "brought" / "eo-eo.csv")
    for name, known in read_addis_orientation(shared_data / ADDIS).items():
        assert np.allclose(brought[name].centre, known.centre)
        assert np.allclose(brought[name].angles, known.angles)
