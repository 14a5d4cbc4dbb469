"""The ortho read onto grids: against GDAL's warp, across sheets, under masks."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np
import pytest
import rasterio
from rasterio.enums import Resampling
from rasterio.transform import Affine
from rasterio.warp import reproject

from core.errors import CrsError, ReferenceDataError
from core.raster.files import FILES, TILES, OpenFiles
from core.raster.grid import Grid
from core.raster.ortho import open_ortho
from tests.core.raster_files import CRS, NORTH, WEST, place, smooth_picture, write_raster


def gdal_warp(path, grid, method=Resampling.cubic, crs=CRS):
    """GDAL's own answer, band by band in single precision."""
    with rasterio.open(path) as file:
        values = np.zeros((file.count, grid.rows, grid.columns), np.float32)
        reproject(
            file.read().astype(np.float32), values, src_transform=file.transform, src_crs=file.crs,
            dst_transform=Affine.from_gdal(*grid.geotransform), dst_crs=crs, resampling=method,
        )  # fmt: skip
    return values


@pytest.mark.parametrize("gsd", [0.13, 0.2, 0.31, 0.5, 0.75])
def test_reading_agrees_with_gdal__oracle(tmp_path, texture, gsd):
    path = write_raster(tmp_path / "a.tif", texture, place(0.2))
    ortho = open_ortho([path], CRS)
    grid = Grid(WEST + 10.03, NORTH - 9.07, gsd, int(50 / gsd), int(40 / gsd))
    patch = ortho.read(grid)
    assert patch.mask.all()
    np.testing.assert_allclose(patch.values, gdal_warp(path, grid)[0], atol=0.01)


def test_a_coarse_grid_is_averaged__truth(tmp_path):
    rng = np.random.default_rng(2)
    noise = rng.integers(0, 255, (640, 640)).astype(np.uint8)
    ortho = open_ortho([write_raster(tmp_path / "a.tif", noise, place(0.2))], CRS)
    patch = ortho.read(Grid(WEST + 12.8, NORTH - 12.8, 3.2, 32, 32))
    # 256 original pixels to each: the spread falls by 16 (GDAL's cubic keeps a little more).
    assert patch.values.std() < noise.std() / 16 * 1.3
    assert abs(patch.values.mean() - noise.mean()) < 0.5


@pytest.mark.parametrize(
    ("gsd", "within"), [(0.2, 2e-3), (0.31, 2e-3), (1.0, 2e-3), (1.9, 2e-3), (2.7, 8.0)]
)
def test_sheet_edges_are_invisible__law(tmp_path, texture, gsd, within):
    # Beyond ten times the pixel size sheets are read through GDAL's own reduction.
    whole = write_raster(tmp_path / "whole.tif", texture, place(0.2))
    cuts = [(0, 0, 137, 111), (137, 0, 263, 111), (0, 111, 137, 189), (137, 111, 263, 189)]
    sheets = [
        write_raster(tmp_path / f"s{i}.tif", texture[r : r + h, c : c + w].copy(), place(0.2, c, r))
        for i, (c, r, w, h) in enumerate(cuts)
    ]
    grid = Grid.over((WEST + 5, NORTH - 55, WEST + 75, NORTH - 5), gsd)
    one, many = open_ortho([whole], CRS), open_ortho(sheets, CRS)
    assert many.bounds == pytest.approx(one.bounds)
    np.testing.assert_allclose(many.read(grid).values, one.read(grid).values, atol=within)


def test_a_pixel_in_two_sheets_counts_once__law(tmp_path, texture):
    whole = write_raster(tmp_path / "whole.tif", texture, place(0.2))
    left = write_raster(tmp_path / "l.tif", texture[:, :230].copy(), place(0.2))
    right = write_raster(tmp_path / "r.tif", texture[:, 170:].copy(), place(0.2, 170))
    grid = Grid(WEST + 4, NORTH - 4, 0.9, 80, 55)
    one = open_ortho([whole], CRS).read(grid)
    np.testing.assert_allclose(
        open_ortho([left, right, right], CRS).read(grid).values, one.values, atol=2e-3
    )


def test_sheets_of_different_pixel_size_join__truth(tmp_path):
    picture = smooth_picture(240, 400).astype(np.uint8)[0]
    coarse = picture.reshape(120, 2, 200, 2).mean(axis=(1, 3))
    fine = write_raster(tmp_path / "fine.tif", picture[:, :200].copy(), place(0.25))
    write_raster(tmp_path / "coarse.tif", coarse[:, 100:].astype(np.uint8), place(0.5, 100))
    ortho = open_ortho([tmp_path / "coarse.tif", fine], CRS)
    assert ortho.ground_sample_distance_m == pytest.approx(0.25)
    grid = Grid(WEST + 30, NORTH - 10, 1.0, 40, 40)
    patch = ortho.read(grid)
    assert patch.mask.all()
    whole = open_ortho([write_raster(tmp_path / "whole.tif", picture, place(0.25))], CRS)
    # Across the join at 50 m the two resolutions agree to the rounding of the coarse one.
    assert np.abs(patch.values - whole.read(grid).values).max() < 3


def test_sheets_half_a_pixel_aside_are_told__truth(tmp_path, texture):
    left = write_raster(tmp_path / "l.tif", texture[:, :200].copy(), place(0.2))
    right = write_raster(tmp_path / "r.tif", texture[:, 200:].copy(), place(0.2, 200.5, -0.5))
    (note,) = open_ortho([left, right], CRS).notes
    assert note.kind == "reference-half-pixel"
    assert "0.1 m" in note.message


def test_nodata_alpha_and_outside_are_masked__truth(tmp_path, texture):
    holed = texture.copy()
    holed[100:150, 200:260] = 0
    nodata = open_ortho([write_raster(tmp_path / "n.tif", holed, place(0.2), nodata=0)], CRS)
    alpha = np.where(holed == 0, 0, 255).astype(np.uint8)
    path = write_raster(
        tmp_path / "a.tif", np.stack([texture] * 3 + [alpha]), place(0.2), photometric="RGB",
        alpha="YES",
    )  # fmt: skip
    grid = Grid(WEST - 10, NORTH + 10, 0.2, 500, 400)
    true = np.zeros((400, 500), bool)
    true[50:350, 50:450] = True
    true[150:200, 250:310] = False
    for ortho in (nodata, open_ortho([path], CRS)):
        patch = ortho.read(grid)
        np.testing.assert_array_equal(patch.mask, true)
        # Beside the hole nothing of its black is drawn in.
        np.testing.assert_allclose(patch.values[true], texture[true[50:350, 50:450]], atol=0.01)


@pytest.mark.parametrize("fill", [0, 255])
def test_a_slanted_ortho_without_nodata_loses_its_collar__truth(tmp_path, fill):
    picture = smooth_picture(600, 600, bands=3).astype(np.uint8)
    y, x = np.mgrid[:600, :600]
    inside = (x + 0.3 * y > 120) & (x + 0.3 * y < 560) & (y - 0.3 * x > -60) & (y - 0.3 * x < 420)
    picture[:, ~inside] = fill
    picture[:, 300:304, 300:304] = fill  # a shadow is no collar
    ortho = open_ortho([write_raster(tmp_path / "c.tif", picture, place(0.5))], CRS)
    mask = ortho.read(Grid(WEST, NORTH, 0.5, 600, 600)).mask
    assert not mask[~inside].any()
    assert mask[inside].mean() > 0.97
    assert mask[290:310, 290:310].all()


def test_a_rotated_sheet_agrees_with_gdal__oracle(tmp_path):
    picture = smooth_picture(300, 300).astype(np.uint8)[0]
    c, s = 0.2 * np.cos(0.44), 0.2 * np.sin(0.44)
    turned = Affine(c, s, WEST, s, -c, NORTH)
    path = write_raster(tmp_path / "t.tif", picture, turned)
    ortho = open_ortho([path], CRS)
    grid = Grid(WEST + 30, NORTH - 5, 0.25, 80, 80)
    patch = ortho.read(grid)
    assert patch.mask.all()
    # OpenCV's interpolation steps by 1/32 pixel and its cubic is another one.
    assert np.abs(patch.values - gdal_warp(path, grid)[0]).max() < 3


def test_a_sheet_in_another_crs_is_reprojected_and_told__oracle(tmp_path):
    picture = smooth_picture(400, 400).astype(np.uint8)[0]
    path = write_raster(tmp_path / "u.tif", picture, place(1.0))
    ortho = open_ortho([path], "EPSG:32634")
    west, south, east, north = ortho.bounds
    grid = Grid((west + east) / 2 - 100, (south + north) / 2 + 100, 1.5, 130, 130)
    patch = ortho.read(grid)
    assert patch.mask.all()
    assert ortho.ground_sample_distance_m == pytest.approx(1.0, abs=0.005)
    (note,) = ortho.notes
    assert note.kind == "reference-reprojected"
    assert "EPSG:32633" in note.message
    assert np.abs(patch.values - gdal_warp(path, grid, crs="EPSG:32634")[0]).max() < 3


def test_neighbours_in_another_crs_join__law(tmp_path):
    picture = smooth_picture(400, 400).astype(np.uint8)[0]
    whole = write_raster(tmp_path / "w.tif", picture, place(1.0))
    left = write_raster(tmp_path / "l.tif", picture[:, :211].copy(), place(1.0))
    right = write_raster(tmp_path / "r.tif", picture[:, 211:].copy(), place(1.0, 211))
    one, two = open_ortho([whole], "EPSG:32634"), open_ortho([left, right], "EPSG:32634")
    west, _, east, north = one.bounds
    grid = Grid((west + east) / 2 - 100, north - 150, 1.0, 200, 100)
    np.testing.assert_allclose(two.read(grid).values, one.read(grid).values, atol=0.2)


def test_colour_and_gray__truth(tmp_path):
    colour = np.zeros((3, 64, 64), np.uint8)
    colour[0], colour[1], colour[2] = 200, 100, 50
    ortho = open_ortho([write_raster(tmp_path / "c.tif", colour, place(1.0))], CRS)
    grid = Grid(WEST + 8, NORTH - 8, 2.0, 16, 16)
    shown = ortho.read_colour(grid)
    assert shown.dtype == np.uint8
    assert (shown == [200, 100, 50]).all()
    expected = 0.299 * 200 + 0.587 * 100 + 0.114 * 50
    np.testing.assert_allclose(ortho.read(grid).values, expected, rtol=1e-5)
    deep = write_raster(tmp_path / "d.tif", (colour.astype(np.uint16) * 16), place(1.0))
    assert open_ortho([deep], CRS).read_colour(grid).max() == 255


def test_jpeg_with_world_file_takes_the_blocks_crs__truth(tmp_path, texture):
    path = write_raster(tmp_path / "j.jpg", texture, place(0.2), driver="JPEG", quality=95)
    (tmp_path / "j.jpg.aux.xml").unlink(missing_ok=True)
    with pytest.raises(ReferenceDataError, match="no place on the ground"):
        open_ortho([path], CRS)
    centre = f"0.2\n0\n0\n-0.2\n{WEST + 0.1}\n{NORTH - 0.1}\n"
    (tmp_path / "j.jgw").write_text(centre)
    ortho = open_ortho([path], CRS)
    assert ortho.bounds == pytest.approx((WEST, NORTH - 60, WEST + 80, NORTH))
    with pytest.raises(CrsError, match="names no CRS"):
        open_ortho([path], "EPSG:2154")


def test_unusable_files_are_told__truth(tmp_path, texture):
    with pytest.raises(ReferenceDataError, match="is not there"):
        open_ortho([tmp_path / "missing.tif"], CRS)
    (tmp_path / "text.tif").write_text("no raster")
    with pytest.raises(ReferenceDataError, match="cannot be read as a raster"):
        open_ortho([tmp_path / "text.tif"], CRS)
    with pytest.raises(ReferenceDataError, match="no ortho is given"):
        open_ortho([], CRS)
    path = write_raster(tmp_path / "cut.tif", texture, place(0.2), compress="deflate")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ReferenceDataError, match=r"cut\.tif"):
        open_ortho([path], CRS).read(Grid(WEST, NORTH, 0.2, 400, 300))


def test_many_threads_and_other_processes_read_the_same__law(tmp_path, texture):
    path = write_raster(
        tmp_path / "a.tif", texture, place(0.2), tiled=True, blockxsize=64, blockysize=64
    )
    ortho = pickle.loads(pickle.dumps(open_ortho([path], CRS)))
    grids = [Grid(WEST + i % 30, NORTH - i % 17, 0.3, 90, 80) for i in range(60)]
    alone = [ortho.read(grid).values for grid in grids]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda grid: ortho.read(grid).values, grids))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


def test_outside_all_sheets_there_is_nothing__truth(tmp_path, texture):
    ortho = open_ortho([write_raster(tmp_path / "a.tif", texture, place(0.2))], CRS)
    patch = ortho.read(Grid(WEST + 500, NORTH, 0.5, 20, 20))
    assert not patch.mask.any()
    assert not patch.values.any()


def test_vovcha_reads_like_gdal__real(shared_data):
    path = shared_data / "vovcha-film" / "ortho" / "ORTO24.2022.SIM00.tif"
    ortho = open_ortho([path], "EPSG:26918")
    grid = Grid(622000.3, 4694000.7, 1.0, 200, 150)
    gray = np.tensordot([0.299, 0.587, 0.114], gdal_warp(path, grid, crs="EPSG:26918"), 1)
    assert np.abs(ortho.read(grid).values - gray).max() < 0.01


def test_sentinel_in_another_crs_than_the_block__real(shared_data):
    folder = shared_data / "ngi-baviaanskloof"
    path = folder / "reference" / "sentinel2_b432_byte.tif"
    lo25 = (folder / "io" / "ngi_xyz_opk.prj").read_text()
    assert not open_ortho([path], lo25).notes  # the same CRS under another name
    ortho = open_ortho([path], "EPSG:32735")
    assert ortho.notes
    grid = Grid(257_000.0, 6_270_000.0, 10.0, 150, 150)
    gray = np.tensordot([0.299, 0.587, 0.114], gdal_warp(path, grid, crs="EPSG:32735"), 1)
    difference = ortho.read(grid).values - gray
    # OpenCV's cubic is a little sharper than GDAL's; a shift of 0.1 px would show as 1.5.
    assert np.sqrt(np.mean(difference**2)) < 0.5


@pytest.mark.parametrize("gsd", [0.2, 0.31, 0.9])
def test_what_is_remembered_is_what_is_read__law(tmp_path, texture, gsd):
    ortho = open_ortho([write_raster(tmp_path / "a.tif", texture, place(0.2))], CRS)
    for bounds in (
        (WEST + 3, NORTH - 45, WEST + 50, NORTH - 4),
        (WEST - 9, NORTH - 30, WEST + 20, NORTH + 8),
    ):
        grid = Grid.over(bounds, gsd)
        TILES.clear()
        first, again = ortho.read(grid), ortho.read(grid)
        np.testing.assert_array_equal(again.mask, first.mask)
        np.testing.assert_array_equal(again.values, first.values)


def test_a_sheet_that_changes_is_read_anew__truth(tmp_path, texture):
    path = write_raster(tmp_path / "a.tif", texture, place(0.2))
    grid = Grid.over((WEST + 3, NORTH - 45, WEST + 50, NORTH - 4), 0.2)
    before = open_ortho([path], CRS).read(grid)
    write_raster(path, 255 - texture, place(0.2))
    after = open_ortho([path], CRS).read(grid)
    np.testing.assert_allclose(after.values, 255 - before.values, atol=1e-3)


class MapServer(ThreadingHTTPServer):
    """Answers WMS 1.1.1 GetMap with a picture of 0.2 m; remembers what it was asked."""

    def __init__(self, picture):
        self.picture, self.asked = np.pad(picture, (0, 256)), list[str]()
        super().__init__(("127.0.0.1", 0), MapRequest)


class MapRequest(BaseHTTPRequestHandler):
    def do_GET(self):
        self.server.asked.append(self.path)
        given = {k.lower(): v[0] for k, v in parse_qs(urlsplit(self.path).query).items()}
        west, _, _, north = map(float, given["bbox"].split(","))
        column, row = round((west - WEST) / 0.2), round((NORTH - north) / 0.2)
        band = self.server.picture[
            row : row + int(given["height"]), column : column + int(given["width"])
        ]
        picture = cv2.imencode(".png", np.repeat(band[..., None], 3, 2))[1].tobytes()
        self.send_response(200)
        self.send_header("Content-Type", "image/png")
        self.send_header("Content-Length", str(len(picture)))
        self.end_headers()
        self.wfile.write(picture)

    def log_message(self, format, *args):
        """Not in the output of tests."""


DESCRIPTION = (
    '<GDAL_WMS><Service name="WMS"><Version>1.1.1</Version><ServerUrl>http://127.0.0.1:{port}/?'
    "</ServerUrl><Layers>ortho</Layers><SRS>{crs}</SRS><ImageFormat>image/png</ImageFormat>"
    "</Service><DataWindow><UpperLeftX>{west}</UpperLeftX><UpperLeftY>{north}</UpperLeftY>"
    "<LowerRightX>{east}</LowerRightX><LowerRightY>{south}</LowerRightY><SizeX>{columns}</SizeX>"
    "<SizeY>{rows}</SizeY></DataWindow><Projection>{crs}</Projection><BlockSizeX>256</BlockSizeX>"
    "<BlockSizeY>256</BlockSizeY><BandsCount>3</BandsCount></GDAL_WMS>"
)


def test_a_web_map_is_read_as_its_picture_and_kept__oracle(tmp_path, texture, monkeypatch):
    path = write_raster(tmp_path / "a.tif", texture, place(0.2))
    rows, columns = texture.shape
    server = MapServer(texture)
    Thread(target=server.serve_forever, daemon=True).start()
    described = tmp_path / "web.xml"
    corner = {"west": WEST, "north": NORTH, "east": WEST + 0.2 * columns}
    described.write_text(
        DESCRIPTION.format(
            port=server.server_address[1], crs=CRS, rows=rows, columns=columns,
            south=NORTH - 0.2 * rows, **corner,
        )
    )  # fmt: skip
    monkeypatch.setattr(FILES, "web_folder", tmp_path / "kept")
    grid = Grid(WEST + 10.03, NORTH - 9.07, 0.31, 90, 70)
    shown = open_ortho([described], CRS).read(grid)
    np.testing.assert_allclose(shown.values, open_ortho([path], CRS).read(grid).values, atol=0.6)
    asked = len(server.asked)
    assert asked == len(set(server.asked)) > 0
    server.shutdown()
    server.server_close()
    again = OpenFiles(1)
    again.web_folder = FILES.web_folder
    TILES.clear()
    with again.borrow(described) as file:
        kept = file.read(1, window=((0, 256), (0, 256)))
    np.testing.assert_array_equal(kept, texture[:256, :256])
    lost = tmp_path / "lost.xml"
    lost.write_text(described.read_text().replace("<Layers>ortho", "<Layers>other"))
    with pytest.raises(ReferenceDataError, match=r"gives no picture: HTTP status code.*connect"):
        open_ortho([lost], CRS).read(grid)
