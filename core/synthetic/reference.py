"""The reference as the user has it: present-day ortho sheets, DEM and road layers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
import shapely
from jaxtyping import Float32, UInt8
from pyogrio import set_gdal_config_options
from pyogrio.raw import write as write_vector
from rasterio import Affine
from rasterio.io import DatasetWriter
from shapely.geometry import LineString, Polygon

from core.raster.grid import Grid
from core.synthetic.flight import SHEET
from core.synthetic.land_cover import Tract
from core.synthetic.landscape import COARSE, Scene
from core.synthetic.network import Network, Road, sway_line
from core.synthetic.options import CRS, seeded
from core.synthetic.painting import Ground, fixed_pixels
from core.synthetic.random_surfaces import Bounds, Field, PlanPoints, Terrain, fractal, smooth_step

Tint = Float32[np.ndarray, "_ _ 3"]
BAND = 1024
NODATA = -9999.0
LAYER_DATE = "2022-11-01"
"""When all vector layers say they were written, so that the same options give the same bytes."""
NODE_SIGMA_M, LINE_SIGMA_M = 0.35, 0.3
"""Deviation per axis of a mapped junction, and of the line between junctions, metres."""
LAYERS = {"main": "SilniceDalnice", "street": "Ulice", "track": "Cesta"}
ORTHO_ERROR_M = 0.1
"""Deviation per axis of the slow displacement of the reference ortho, metres."""


def write_sheets(
    folder: Path, ground: Ground, scene: Scene, gsd_m: tuple[float, float], *, year: int
) -> None:
    """Two by two colour sheets of the present ground; the last one has another pixel size.

    Args:
        folder: Where to write them.
        ground: The painted present.
        scene: Its scene, for the colours.
        gsd_m: Ground sample distance of three sheets, and of the fourth, metres.
        year: Year of the flight, for the names.
    """
    folder.mkdir(parents=True, exist_ok=True)
    west, south, east, north = ground.grid.bounds
    middle_east = west + round((east - west) / 2 / 4.0) * 4.0
    middle_north = south + round((north - south) / 2 / 4.0) * 4.0
    tint, tint_grid = _tint(scene, ground.grid)
    rng = seeded(scene.seed, "ortho")
    shift = [
        ORTHO_ERROR_M * fractal((64, 64), 1.0, 8.0, 32.0, slope=1.0, rng=rng) for _ in range(2)
    ]
    for number, (box, name) in enumerate(
        (
            ((west, middle_north, middle_east, north), 35),
            ((middle_east, middle_north, east, north), 25),
            ((west, south, middle_east, middle_north), 36),
            ((middle_east, south, east, middle_north), 26),
        )
    ):
        grid = Grid.over(box, gsd_m[number == 3])
        gain = float(rng.uniform(0.94, 1.08))
        path = folder / f"ORTO24.{year}.{SHEET[:4]}{name}.tif"
        options = {"compress": "jpeg", "jpeg_quality": 93, "photometric": "ycbcr"}
        with _created(path, grid, 3, "uint8", options=options) as sheet:
            for row in range(0, grid.rows, BAND):
                part = grid.window(0, row, grid.columns, min(BAND, grid.rows - row))
                gray = gain * sample_ground(ground, part, (shift[0], shift[1]))
                colour = gray[:, :, None] * _tint_on(tint, tint_grid, part)
                bands = np.moveaxis(np.clip(colour, 0, 255).astype(np.uint8), 2, 0)
                sheet.write(bands, window=((row, row + part.rows), (0, part.columns)))


def write_truth_ortho(path: Path, ground: Ground, gsd_m: float) -> None:
    """The ground of the archival epoch, exactly where it was."""
    grid = Grid.over(ground.grid.bounds, gsd_m)
    with _created(path, grid, 1, "uint8", options={"compress": "deflate", "zlevel": 1}) as raster:
        for row in range(0, grid.rows, BAND):
            part = grid.window(0, row, grid.columns, min(BAND, grid.rows - row))
            gray = np.clip(np.round(sample_ground(ground, part, None)), 0, 255).astype(np.uint8)
            raster.write(gray, 1, window=((row, row + part.rows), (0, part.columns)))


def write_dem(path: Path, terrain: Terrain, bounds: Bounds, gsd_m: float, seed: int) -> None:
    """Bare earth with an error of 0.4 m, half of it alike over some 30 m, and one gap."""
    grid = _around(bounds, 60.0, gsd_m)
    rng = seeded(seed, "dem")
    slow = fractal((grid.rows, grid.columns), gsd_m, 15.0, 60.0, slope=0.5, rng=rng)
    noise = rng.standard_normal((grid.rows, grid.columns), dtype=np.float32)
    heights = terrain.on(grid) + 0.28 * slow + 0.28 * noise
    place = rng.uniform(0.25, 0.75, 2) * np.array([grid.columns, grid.rows])
    size = rng.uniform(12.0, 30.0, 2) / gsd_m
    column, row = np.meshgrid(np.arange(grid.columns), np.arange(grid.rows))
    gap = ((column - place[0]) / size[0]) ** 2 + ((row - place[1]) / size[1]) ** 2 < 1
    heights[gap] = NODATA
    with _created(
        path, grid, 1, "float32", options={"compress": "deflate", "zlevel": 1, "nodata": NODATA}
    ) as raster:
        raster.write(heights.astype(np.float32), 1)


def write_terrain(path: Path, terrain: Terrain, bounds: Bounds) -> None:
    """The true heights, every five metres."""
    grid = _around(bounds, 60.0, 5.0)
    with _created(path, grid, 1, "float32", options={"compress": "deflate", "zlevel": 1}) as raster:
        raster.write(terrain.on(grid).astype(np.float32), 1)


def write_roads(folder: Path, network: Network, seed: int) -> None:
    """The present roads in three shapefiles.

    Through roads pass some junctions with roads of another layer uncut; other pieces are cut
    where only an attribute changes; some ends miss their junction by a few decimetres.

    Args:
        folder: Where to write them.
        network: Roads of both epochs.
        seed: Seed of the block.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = seeded(seed, "road layers")
    shifts = rng.normal(0.0, NODE_SIGMA_M, network.nodes.shape)
    lines: dict[str, list[tuple[PlanPoints, int]]] = {name: [] for name in LAYERS.values()}
    for road in network.roads:
        if road.exists_now:
            line = _mapped(road, shifts, rng)
            lines[LAYERS[road.kind]].append((line, road.route))
    for name, pieces in lines.items():
        if name == "SilniceDalnice":
            pieces = _joined(pieces, rng)
        _write_roads(folder / f"{name}.shp", name, _cut(pieces, rng))


def _mapped(road: Road, shifts: PlanPoints, rng: np.random.Generator) -> PlanPoints:
    """The line as digitised: displaced ends, slow deviation, few vertices."""
    share = np.linspace(0.0, 1.0, len(road.now))[:, None]
    line = road.now + (1 - share) * shifts[road.start] + share * shifts[road.end]
    line = sway_line(line, LINE_SIGMA_M, rng)
    if rng.random() < 0.06:
        line[-1] += rng.uniform(-0.3, 0.3, 2)
    simple = shapely.simplify(LineString(line), 0.25)
    return shapely.get_coordinates(simple)


def _joined(
    pieces: list[tuple[PlanPoints, int]], rng: np.random.Generator
) -> list[tuple[PlanPoints, int]]:
    """Pieces of one route put together at half of the nodes they share."""
    result: list[tuple[PlanPoints, int]] = []
    for line, route in pieces:
        for number, (other, other_route) in enumerate(result):
            chain = _chained(other, line) if route == other_route else None
            if chain is not None and rng.random() < 0.5:
                result[number] = (chain, route)
                break
        else:
            result.append((line, route))
    return result


def _chained(one: PlanPoints, other: PlanPoints) -> PlanPoints | None:
    """Two lines as one where an end meets an end, else None."""
    for first in (one, one[::-1]):
        for second in (other, other[::-1]):
            if float(np.max(np.abs(first[-1] - second[0]))) < 1e-6:
                return np.vstack([first, second[1:]])
    return None


def _cut(
    pieces: list[tuple[PlanPoints, int]], rng: np.random.Generator
) -> list[tuple[PlanPoints, int]]:
    """A quarter of the pieces cut in two where an attribute changes."""
    result: list[tuple[PlanPoints, int]] = []
    for line, route in pieces:
        if len(line) > 4 and rng.random() < 0.25:
            at = int(rng.integers(1, len(line) - 1))
            result += [(line[: at + 1], route), (line[at:], route + 5000)]
        else:
            result.append((line, route))
    return result


def _write_roads(path: Path, name: str, pieces: list[tuple[PlanPoints, int]]) -> None:
    kinds = {
        "SilniceDalnice": ("TYP_SIL_K", ("S2", "S3")),
        "Ulice": ("TYP_UL_K", ("UL", "UL")),
        "Cesta": ("TYP_CES_K", ("C1", "C2")),
    }
    field, values = kinds[name]
    columns = {
        "FID_ZBG": np.arange(1, len(pieces) + 1, dtype=np.int32),
        field: np.array([values[(route // 5) % 2] for _, route in pieces], dtype=object),
    }
    write_layer(path, [LineString(line) for line, _ in pieces], columns)


def write_layer(
    path: Path, shapes: Sequence[LineString | Polygon], columns: Mapping[str, Any]
) -> None:
    """A vector layer in the block's CRS, the same bytes whenever it is written.

    Args:
        path: A `.gpkg` or `.shp`; the layer is named after it.
        shapes: Lines or polygons.
        columns: Attributes by name, a value for each shape.
    """
    shapefile = path.suffix == ".shp"
    options = {"DBF_DATE_LAST_UPDATE": LAYER_DATE} if shapefile else {}
    set_gdal_config_options({"OGR_CURRENT_DATE": f"{LAYER_DATE}T00:00:00.000Z"})
    try:
        write_vector(
            path,
            geometry=shapely.to_wkb(np.array(shapes, dtype=object)),
            field_data=[np.asarray(column) for column in columns.values()],
            fields=list(columns),
            geometry_type=shapes[0].geom_type,
            crs=CRS,
            driver="ESRI Shapefile" if shapefile else "GPKG",
            layer=path.stem,
            encoding="CP1250" if shapefile else None,
            layer_options=options,
        )
    finally:
        set_gdal_config_options({"OGR_CURRENT_DATE": None})


def blur_ground(ground: Ground, sigma_px: float) -> None:
    """Blur the painted ground in place, so that a coarser raster may be taken from it."""
    reach = int(4 * sigma_px) + 2
    before = ground.gray[:0]
    for row in range(0, ground.grid.rows, BAND):
        below = ground.gray[row : row + BAND + reach]
        blurred = cv2.GaussianBlur(np.vstack([before, below]), (0, 0), sigma_px)
        fresh = np.asarray(blurred)[len(before) : len(before) + BAND]
        # The rows above have been overwritten: keep their old values for the next band.
        before = ground.gray[max(0, row + BAND - reach) : row + BAND].copy()
        ground.gray[row : row + BAND] = fresh


def sample_ground(ground: Ground, part: Grid, shift: tuple[Field, Field] | None) -> Field:
    """The painted ground on a grid of another size, antialiased, displaced in metres if asked."""
    ratio = part.ground_sample_distance_m / ground.grid.ground_sample_distance_m
    column, row = ground.grid.grid_from_object(np.array([[part.west, part.north]]))[0]
    columns = (column + (np.arange(part.columns) + 0.5) * ratio - 0.5)[None, :]
    rows = (row + (np.arange(part.rows) + 0.5) * ratio - 0.5)[:, None]
    columns = np.repeat(columns, part.rows, axis=0).astype(np.float32)
    rows = np.repeat(rows, part.columns, axis=1).astype(np.float32)
    if shift is not None:
        size = (ground.grid.columns, ground.grid.rows)
        for target, field in ((columns, shift[0]), (rows, shift[1])):
            place_x = columns * np.float32(field.shape[1] / size[0])
            place_y = rows * np.float32(field.shape[0] / size[1])
            moved = cv2.remap(
                field, place_x, place_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            target += np.asarray(moved) / np.float32(ground.grid.ground_sample_distance_m)
    first = max(0, int(rows.min()) - 4)
    last = min(ground.grid.rows, int(rows.max()) + 5)
    left = max(0, int(columns.min()) - 4)
    right = min(ground.grid.columns, int(columns.max()) + 5)
    source = ground.gray[first:last, left:right].astype(np.float32)
    if ratio > 1.05:
        source = cv2.GaussianBlur(source, (0, 0), 0.42 * ratio)
    result = cv2.remap(
        source, columns - left, rows - first, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    return np.clip(np.asarray(result, dtype=np.float32), 0, 255)


def _around(bounds: Bounds, margin_m: float, gsd_m: float) -> Grid:
    west, south, east, north = bounds
    wider = (west - margin_m, south - margin_m, east + margin_m, north + margin_m)
    return Grid.over(wider, gsd_m)


def _created(
    path: Path, grid: Grid, bands: int, dtype: str, *, options: Mapping[str, Any]
) -> DatasetWriter:
    path.parent.mkdir(parents=True, exist_ok=True)
    gsd = grid.ground_sample_distance_m
    return rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=grid.columns,
        height=grid.rows,
        count=bands,
        dtype=dtype,
        crs=CRS,
        transform=Affine(gsd, 0.0, grid.west, 0.0, -gsd, grid.north),
        tiled=True,
        blockxsize=256,
        blockysize=256,
        BIGTIFF="IF_SAFER",
        **options,
    )


def _tint(scene: Scene, grid: Grid) -> tuple[UInt8[np.ndarray, "_ _ 3"], Grid]:
    """Colour at every fourth pixel: 128 times red, green, blue of mean luminance 1."""
    gsd = grid.ground_sample_distance_m * COARSE
    coarse = Grid(grid.west, grid.north, gsd, -(-grid.columns // COARSE), -(-grid.rows // COARSE))
    picture = np.full((coarse.rows, coarse.columns, 3), _coded((0.95, 1.05, 0.83)), dtype=np.uint8)
    for tract in scene.tracts:
        _fill(picture, tract, coarse)
    wood = smooth_step(scene.fields.wood, scene.fields.grid, coarse) > 0.5
    picture[wood] = _coded((0.92, 1.06, 0.86))
    thick = max(1, round(6.0 / gsd))
    for road, look in scene.roads:
        gray = _coded((1.03, 0.99, 0.95) if look.tone > 130 else (0.98, 1.0, 1.04))
        line = fixed_pixels(road.line(scene.past), coarse)
        cv2.polylines(picture, [line], False, gray, thick, cv2.LINE_8, 8)
    for house in scene.houses:
        roof = _coded((1.3, 0.9, 0.8) if house.red else (1.0, 1.0, 1.03))
        cv2.fillConvexPoly(picture, fixed_pixels(house.corners, coarse), roof, cv2.LINE_8, 8)
    return picture, coarse


def _fill(picture: UInt8[np.ndarray, "_ _ 3"], tract: Tract, grid: Grid) -> None:
    cv2.fillPoly(picture, [fixed_pixels(tract.outline, grid)], _coded(tract.tint), cv2.LINE_8, 8)


def _coded(tint: tuple[float, float, float]) -> tuple[int, int, int]:
    """Red, green, blue as bytes, scaled so that the luminance of a gray is kept."""
    luminance = 0.299 * tint[0] + 0.587 * tint[1] + 0.114 * tint[2]
    red, green, blue = (min(255, round(128 * value / luminance)) for value in tint)
    return red, green, blue


def _tint_on(tint: UInt8[np.ndarray, "_ _ 3"], source: Grid, part: Grid) -> Tint:
    """The colours brought onto a part of a sheet."""
    layers = [smooth_step(tint[:, :, k].astype(np.float32), source, part) for k in range(3)]
    return np.stack(layers, axis=2) / np.float32(128.0)
