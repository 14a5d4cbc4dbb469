"""QGIS points in every variant of FORMATS 4.5."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.errors import ScanError
from core.formats.qgis_points import (
    QgisPoints,
    find_qgis_points,
    read_qgis_points,
    read_scan_points,
    write_qgis_points,
)
from core.formats.world_file import write_world_file

NOW = "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual\n"
PLANE = [[-743011.77, -1043823.16], [-742000.0, -1044000.0]]
PIXELS = [[474.5, 350.5], [900.25, 1200.75]]
ROWS = "-743011.77,-1043823.16,474.5,-350.5,1,0,0,0\n-742000,-1044000,900.25,-1200.75,0,1,2,3\n"
VARIANTS = {
    "now": "#CRS: EPSG:5514\n" + NOW + ROWS,
    "bom": "\ufeff#CRS: EPSG:5514\n" + NOW + ROWS,
    "without-crs": NOW + ROWS,
    "older": "mapX,mapY,pixelX,pixelY,enable,dX,dY,residual\n" + ROWS,
    "tabs": "mapX\tmapY\tpixelX\tpixelY\tenable\n"
    + "\n".join("\t".join(row.split(",")[:5]) for row in ROWS.splitlines()),
    "headless": "\n".join("\t".join(row.split(",")[:4]) for row in ROWS.splitlines()),
    "upright": "#CRS: EPSG:5514\n"
    + NOW
    + ROWS.replace("-350.5", "350.5").replace("-1200.75", "1200.75"),
    "crs-in-rows": NOW.strip() + ",crs\n" + ROWS.replace(",0,0,0\n", ",0,0,0,EPSG:5514\n"),
}


@pytest.mark.parametrize("variant", list(VARIANTS))
def test_every_variant_reads_alike__truth(tmp_path: Path, variant: str) -> None:
    path = tmp_path / "scan.tif.points"
    path.write_text(VARIANTS[variant], encoding="utf-8")
    points = read_qgis_points(path)
    np.testing.assert_allclose(points.plane, PLANE)
    np.testing.assert_allclose(points.pixels, PIXELS)
    assert points.enabled.tolist() == [True, variant == "headless"]
    assert points.crs == (
        "EPSG:5514" if variant in ("now", "bom", "upright", "crs-in-rows") else ""
    )


@pytest.mark.parametrize("up", [-1, 1])
def test_sources_in_map_units_are_brought_into_the_scan__law(tmp_path: Path, up: int) -> None:
    """QGIS counts so in a scan that has a georeference, whatever the sign of its map's north."""
    matrix = np.array([[0.5, 0.1, -743250.0], [0.1, -0.5, up * 1043600.0]])
    write_world_file(tmp_path / "scan.tfw", matrix)
    source = np.array(PIXELS) @ matrix[:, :2].T + matrix[:, 2]
    rows = [[*plane, *place, 1, 0, 0, 0] for plane, place in zip(PLANE, source, strict=True)]
    path = tmp_path / "scan.tif.points"
    path.write_text(NOW + "".join(",".join(map(str, row)) + "\n" for row in rows))
    points = read_scan_points(path, tmp_path / "scan.tif", (1000, 1500))
    np.testing.assert_allclose(points.pixels, PIXELS, atol=1e-5)
    np.testing.assert_allclose(points.plane, PLANE)
    path.write_text(NOW + ROWS)
    plain = read_scan_points(path, tmp_path / "scan.tif", (1000, 1500))
    np.testing.assert_allclose(plain.pixels, PIXELS)


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            st.floats(-1e7, 1e7), st.floats(-1e7, 1e7), st.floats(0, 3e4), st.floats(1, 3e4),
            st.booleans(),
        ),
        min_size=1, max_size=9,
    )
)  # fmt: skip
def test_written_and_read__law(tmp_path_factory: pytest.TempPathFactory, rows: list) -> None:
    values = np.array([row[:4] for row in rows], dtype=np.float64)
    enabled = np.array([row[4] for row in rows])
    path = tmp_path_factory.mktemp("points") / "a.points"
    write_qgis_points(path, QgisPoints(path, "EPSG:5514", values[:, :2], values[:, 2:], enabled))
    back = read_qgis_points(path)
    np.testing.assert_array_equal(back.plane, values[:, :2])
    np.testing.assert_array_equal(back.pixels, values[:, 2:])
    np.testing.assert_array_equal(back.enabled, enabled)
    assert back.crs == "EPSG:5514"


def test_found_with_either_name__truth(tmp_path: Path) -> None:
    assert find_qgis_points(tmp_path / "a.tif") is None
    (tmp_path / "a.points").touch()
    assert find_qgis_points(tmp_path / "a.tif") == tmp_path / "a.points"
    (tmp_path / "a.tif.points").touch()
    assert find_qgis_points(tmp_path / "a.tif") == tmp_path / "a.tif.points"


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "no points"), ("mapX,mapY,sourceX,enable\n1,2,3,1\n", "sourceY is missing"),
     (NOW + "1,2,x,4,1,0,0,0\n", "not of numbers"), (NOW + "1,2\n", "not of numbers"),
     (NOW + "1,2,3,-inf,1,0,0,0\n", "not finite")],
)  # fmt: skip
def test_unusable_points_say_why__truth(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.points"
    path.write_text(text)
    with pytest.raises(ScanError, match=words):
        read_qgis_points(path)
