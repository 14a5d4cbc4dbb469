"""The surface as a point cloud: LAZ for every program, COPC for those that read it by parts.

COPC (copc.io, 1.0) is LAZ 1.4 whose points stand in an octree. Every second cell of the surface
stands in its finest nodes, every second of the rest in the next coarser ones, and so on: the nodes
down to a depth are a surface of that resolution.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import rasterio
from jaxtyping import Float64, Shaped
from pyproj import CRS
from pyproj.enums import WktVersion

from core.errors import ProjectError
from core.frames import HALF_PIXEL
from core.progress import Work
from core.raster.grid import BLOCK_PX, Grid, Tile, disk_full, tiles_of, window_of
from core.surface.ground import NODATA_M
from core.surface.stage import SurfaceFiles

PACKAGES = ("laspy", "lazrs")
# design: some fifty thousand points a node: what a viewer asks for at a time.
NODE_CELLS = 256
"""Cells along the side of a node, as many at every depth."""
# design: a tenth of the best height that scans give.
STEP_M = 0.001
"""Coordinates are whole multiples of this, metres."""
# source: ASPRS, LAS Specification 1.4-R15, point data record format 6 and its fields.
FORMAT = 6
ONE_OF_ONE = 0x11  # source: the same, return number and number of returns
UNCLASSIFIED = 1  # source: the same, classes of points
# source: the same, its fields in their order.
POINT = np.dtype(
    [
        ("place", "<i4", 3), ("intensity", "<u2"), ("returns", "u1"), ("flags", "u1"),
        ("kind", "u1"), ("pairs", "u1"), ("angle", "<i2"), ("source", "<u2"), ("time", "<f8"),
        ("sigma_z", "<f4"),
    ]
)  # fmt: skip
"""A point of format 6, whose user data are the pairs; the last four bytes are extra bytes."""
# source: COPC 1.0, info VLR and hierarchy EVLR: who they are of, their numbers, and their fields.
OWNER, INFO, HIERARCHY = "copc", 1, 1000
WKT = 2112  # source: LAS Specification 1.4-R15, OGC coordinate system WKT record
INFO_FIELDS = "<5d2Q2d88x"
"""Middle, half side and spacing of the root; where the hierarchy lies, its length; times."""
# source: COPC 1.0, hierarchy EVLR
ENTRY = np.dtype([("key", "<i4", 4), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])
# source: LAS Specification 1.4-R15, public header block: day and year of creation, 0 for unknown.
CREATED_AT = 90
# source: LAS Specification 1.4-R15, extended variable length records.
EVLR_HEAD = "<H16sHQ32s"

Key = tuple[int, int, int, int]
"""Depth, and column, row and layer of a node, from west, south and below."""
Points = Shaped[np.ndarray, "n"]
"""Of type `POINT`."""
Corner = Float64[np.ndarray, "3"]
"""Easting, northing, height, metres."""
Nodes = dict[Key, tuple[int, int, int]]
"""Where a node begins in the file, its bytes and its points."""


@dataclass(frozen=True, slots=True)
class _Surface:
    """The open rasters of a surface."""

    heights: Any
    sigmas: Any
    pairs: Any


def check_cloud_writer(file: Path) -> None:
    """Make sure that point clouds can be written here.

    Args:
        file: What asks for one.

    Raises:
        ProjectError: The libraries are not installed.
    """
    if not all(map(find_spec, PACKAGES)):
        raise ProjectError(
            file,
            "[surface] point_cloud needs the libraries laspy and lazrs, which are not installed.",
            "Install them with: pip install 'gruber[cloud]', or leave it out.",
        )


def write_cloud(path: Path, surface: SurfaceFiles, grid: Grid, crs: str, work: Work) -> int:
    """Write the known cells of a surface as points.

    User data of a point are the pairs of photos that agree there, `sigma_z` the standard deviation
    of its height, metres.

    Args:
        path: The file.
        surface: The rasters of the surface.
        grid: Where their cells lie.
        crs: The block's CRS.
        work: Told node by node.

    Returns:
        Number of points.

    Raises:
        OSError: The disk is full.
    """
    # Extras: who asks for no point cloud needs no library that writes them.
    from laspy.vlrs.known import LasZipVlr

    lazrs: Any = import_module("lazrs")  # Its types are written nowhere.
    with (
        rasterio.open(surface.surface) as heights,
        rasterio.open(surface.sigma) as sigmas,
        rasterio.open(surface.count) as pairs,
        path.open("wb") as out,
    ):
        cube = _cube_around(heights, grid)
        layout = lazrs.LazVlr.new_for_compression(FORMAT, POINT["sigma_z"].itemsize, True)
        head = _head(cube, crs)
        head.vlrs.insert(1, LasZipVlr(bytes(layout.record_data())))
        head.write_to(out)
        compressor = lazrs.LasZipCompressor(out, layout)
        compressor.reserve_offset_to_chunk_table()
        nodes: Nodes = {}
        ends: list[np.ndarray] = []
        try:
            for key, points in _nodes(cube, _Surface(heights, sigmas, pairs), work):
                start = out.tell()
                compressor.compress_chunks([points.tobytes()])
                nodes[key] = start, out.tell() - start, len(points)
                ends += [points["place"].min(axis=0), points["place"].max(axis=0)]
            compressor.done()
        except lazrs.LazrsError as error:
            # The compressor cannot fail; what it writes to can.
            raise disk_full(path) from error
        head.mins, head.maxs = (
            cube.origin + end * STEP_M for end in (np.min(ends, axis=0), np.max(ends, axis=0))
        )
        _close(out, head, cube, nodes)
    return sum(count for *_, count in nodes.values())


@dataclass(frozen=True, slots=True)
class _Cube:
    """The cube that the octree divides; its top lies along the north edge of the grid."""

    grid: Grid
    below: float
    """Height of its lowest side, metres."""
    depth: int
    """Of the finest nodes."""

    @property
    def side_m(self) -> float:
        """Length of its sides, metres."""
        return NODE_CELLS * 2**self.depth * self.grid.ground_sample_distance_m

    @property
    def corner(self) -> Corner:
        """West, south, below."""
        return np.array([self.grid.west, self.grid.north - self.side_m, self.below])

    @property
    def origin(self) -> Corner:
        """What coordinates are counted from: whole metres."""
        return np.floor(self.corner)

    def step(self, depth: int) -> int:
        """Cells from one point to the next in nodes of a depth."""
        return 2 ** (self.depth - depth)


def _cube_around(heights: Any, grid: Grid) -> _Cube:
    """The smallest cube of whole nodes about a surface."""
    lowest, highest = np.inf, -np.inf
    for tile in tiles_of(grid, BLOCK_PX):
        values = heights.read(1, window=window_of(tile), masked=True)
        if values.count():
            lowest, highest = min(lowest, float(values.min())), max(highest, float(values.max()))
    gsd = grid.ground_sample_distance_m
    cells = max(grid.columns, grid.rows, (highest - lowest) / gsd + 1)
    depth = max(0, int(np.ceil(np.log2(cells / NODE_CELLS))))
    return _Cube(grid, float(np.floor(lowest)), depth)


def _head(cube: _Cube, crs: str) -> Any:
    """The head of the file, which does not know the points and their hierarchy yet."""
    import laspy

    head = laspy.LasHeader(version="1.4", point_format=FORMAT)
    head.add_extra_dim(laspy.ExtraBytesParams("sigma_z", "f4", "of the height, metres"))
    head.scales, head.offsets = np.full(3, STEP_M), cube.origin
    head.generating_software = "Gruber"
    head.vlrs.insert(0, _info(cube, 0, 0))
    wkt = CRS.from_user_input(crs).to_wkt(WktVersion.WKT1_GDAL)
    head.vlrs.append(laspy.VLR("LASF_Projection", WKT, "", wkt.encode() + b"\0"))
    head.global_encoding.wkt = True
    head.are_points_compressed = True
    return head


def _info(cube: _Cube, offset: int, size: int) -> Any:
    """What a reader of COPC begins with."""
    import laspy

    middle = (cube.corner + cube.side_m / 2).tolist()
    half, spacing = cube.side_m / 2, cube.side_m / NODE_CELLS
    data = struct.pack(INFO_FIELDS, *middle, half, spacing, offset, size, 0.0, 0.0)
    return laspy.VLR(OWNER, INFO, "", data)


def _close(out: BinaryIO, head: Any, cube: _Cube, nodes: Nodes) -> None:
    """Write the hierarchy behind the points, and the head again."""
    above = _parents(set(nodes)) - set(nodes)
    # A node that has no points itself leads to those below it.
    every = nodes | dict.fromkeys(sorted(above), (0, 0, 0))
    entries = np.array([(key, *node) for key, node in every.items()], dtype=ENTRY).tobytes()
    start = out.tell()
    out.write(struct.pack(EVLR_HEAD, 0, OWNER.encode(), HIERARCHY, len(entries), b""))
    where = out.tell()
    out.write(entries)
    count = sum(points for *_, points in nodes.values())
    head.vlrs[0] = _info(cube, where, len(entries))
    head.point_count = head.number_of_points_by_return[0] = count
    head.start_of_first_evlr, head.number_of_evlrs = start, 1
    out.seek(0)
    head.write_to(out, ensure_same_size=True)
    # The same surface gives the same bytes, on whatever day it is written.
    out.seek(CREATED_AT)
    out.write(bytes(4))


def _nodes(cube: _Cube, surface: _Surface, work: Work) -> Iterator[tuple[Key, Points]]:
    """Every node that has points, from the coarsest to the finest."""
    levels = [list(tiles_of(cube.grid, NODE_CELLS * cube.step(d))) for d in range(cube.depth + 1)]
    done, total = 0, sum(map(len, levels))
    for depth, tiles in enumerate(levels):
        for tile in tiles:
            yield from _nodes_of(cube, depth, tile, surface)
            done += 1
            work.progress.report(done, total, "point cloud")


def _nodes_of(
    cube: _Cube, depth: int, tile: Tile, surface: _Surface
) -> Iterator[tuple[Key, Points]]:
    """The nodes that stand above each other on a tile of the grid."""
    step = cube.step(depth)
    values = _thinned(surface.heights, tile, step)
    own = values != NODATA_M
    rows, columns = np.nonzero(own)
    rows, columns = tile[1] + rows * step, tile[0] + columns * step
    found = np.zeros(len(rows), dtype=POINT)
    plan = cube.grid.object_from_grid(np.column_stack([columns, rows]) + HALF_PIXEL)
    place = np.column_stack([plan, values[own]])
    found["place"] = np.rint((place - cube.origin) / STEP_M)
    found["returns"], found["kind"] = ONE_OF_ONE, UNCLASSIFIED
    found["pairs"] = _thinned(surface.pairs, tile, step)[own]
    found["sigma_z"] = _thinned(surface.sigmas, tile, step)[own]
    # Cells of coarser nodes stand there already.
    new = ((columns | rows) % (2 * step) > 0) if depth else np.ones(len(rows), dtype=bool)
    key = np.floor((place - cube.corner) / cube.side_m * 2**depth).astype(np.int64)
    for layer in np.unique(key[new, 2]).tolist():
        inside = new & (key[:, 2] == layer)
        column, row = key[inside][0, :2].tolist()
        yield (depth, column, row, layer), found[inside]


def _thinned(raster: Any, tile: Tile, step: int) -> Shaped[np.ndarray, "rows columns"]:
    """Every so many cells of a tile, read in bands."""
    column, row, columns, rows = tile
    # A band begins with a row that is wanted, however far apart these are.
    bands = [
        raster.read(1, window=window_of((column, top, columns, min(BLOCK_PX, row + rows - top))))
        for top in range(row, row + rows, max(BLOCK_PX, step))
    ]
    return np.vstack([band[::step, ::step] for band in bands])


def _parents(keys: set[Key]) -> set[Key]:
    """All nodes above some, up to the root."""
    found: set[Key] = set()
    for depth, *place in keys:
        for above in range(1, depth + 1):
            column, row, layer = (number >> above for number in place)
            found.add((depth - above, column, row, layer))
    return found
