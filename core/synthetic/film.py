"""Exposes the ground onto film, develops it, and scans it with all its scars."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from scipy.sparse import csr_matrix

from core.arrays import FilmPoints
from core.geometry.camera import Camera
from core.synthetic.flight import Exposure
from core.synthetic.options import FilmOptions, seeded
from core.synthetic.painting import Ground
from core.synthetic.random_surfaces import LATTICE_M, Terrain, fractal, stretched_band, white

Field = Float32[np.ndarray, "_ _"]
Picture = UInt8[np.ndarray, "_ _"]
NODE_PX, FINE_NODE_PX = 8, 4
"""Distance of the nodes at which rays are followed to the ground; between them cubic. The finer
one is for ground with something on it."""
BAND = 512
"""Rows developed at a time."""
FILM_MM = 191.0
"""Width of the film itself; beyond lies the scanner's bed."""
EDGE = 8
"""Rows more on both sides of a band, so that blurs do not end at its edge."""
ARM_MM, HALF_WIDTH_MM = 2.4, 0.13
"""Length of an arm of a fiducial from its middle, and half the width of its line."""
GAP_MM, DOT_MM = 0.6, 0.24
"""Radii of the free space about the middle of a fiducial and of the dot in it."""
TAB_MM = 4.0
"""Half the width of the dark tab that carries a fiducial into the picture."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelMaps:
    """Where each scan pixel looks on the ground, known at nodes."""

    columns: Float32[np.ndarray, "nodes_down nodes_right"]
    """Column of the ground raster (OpenCV's count) at the nodes."""
    rows: Float32[np.ndarray, "nodes_down nodes_right"]
    """Row of the ground raster at the nodes."""
    size_px: tuple[int, int]
    """Columns and rows of the scan."""
    node_px: int = NODE_PX
    """Distance of the nodes."""

    def band(self, first: int, last: int) -> tuple[Field, Field]:
        """Both coordinates for all pixels of the scan's rows first to last - 1."""
        down = _between(first, last, self.columns.shape[0], self.node_px)
        right = _between(0, self.size_px[0], self.columns.shape[1], self.node_px)
        columns = np.asarray((right @ (down @ self.columns).T).T, dtype=np.float32)
        rows = np.asarray((right @ (down @ self.rows).T).T, dtype=np.float32)
        return np.ascontiguousarray(columns), np.ascontiguousarray(rows)


def make_scan(
    ground: Ground,
    terrain: Terrain,
    exposure: Exposure,
    camera: Camera,
    *,
    seed: int,
    options: FilmOptions,
) -> Picture:
    """The scan of one exposure.

    Args:
        ground: The painted epoch, already as soft as the film's resolution.
        terrain: The true terrain.
        exposure: The exposure with its true orientations.
        camera: The true camera, fiducials included.
        seed: Seed of the block.
        options: Lens and film.

    Returns:
        The scan, 8 bit, without notes and scars.
    """
    columns, rows = exposure.size_px
    maps = pixel_maps(ground, terrain, exposure, camera)
    scan = np.empty((rows, columns), dtype=np.uint8)
    dark_room = _DarkRoom(exposure, camera, seed, options)
    for first in range(0, rows, BAND):
        last = min(first + BAND, rows)
        light = expose_band(ground, maps, first - EDGE, last + EDGE)
        scan[first:last] = dark_room.develop(light, first - EDGE)[EDGE:-EDGE]
    return scan


def pixel_maps(ground: Ground, terrain: Terrain, exposure: Exposure, camera: Camera) -> PixelMaps:
    """Follow the rays of the nodes through lens and air down to the terrain."""
    columns, rows = exposure.size_px
    node = NODE_PX if terrain.grid.ground_sample_distance_m >= LATTICE_M else FINE_NODE_PX
    across = (np.arange(-(-columns // node) + 4) - 1.5) * node
    down = (np.arange(-(-rows // node) + 4) - 1.5) * node
    column, row = np.meshgrid(across, down)
    pixels = np.column_stack([column.ravel(), row.ravel()])
    places = exposure.ground_from_pixel(pixels, terrain, camera)
    seen = ground.grid.grid_from_object(places[:, :2]) - 0.5
    return PixelMaps(
        seen[:, 0].reshape(column.shape).astype(np.float32),
        seen[:, 1].reshape(column.shape).astype(np.float32),
        exposure.size_px,
        node,
    )


def _between(first: int, last: int, nodes: int, node_px: int) -> csr_matrix:
    """Cubic convolution weights (Keys, a = -1/2: exact for parabolas) of pixels on nodes."""
    # The centre of pixel i is i + 0.5; node k lies at (k - 1.5) node_px.
    place = (np.arange(first, last) + 0.5) / node_px + 1.5
    place = np.clip(place, 1.0, nodes - 2.001)
    base = np.floor(place).astype(np.int64)
    t = place - base
    weights = np.stack(
        [
            -0.5 * t**3 + t**2 - 0.5 * t,
            1.5 * t**3 - 2.5 * t**2 + 1.0,
            -1.5 * t**3 + 2.0 * t**2 + 0.5 * t,
            0.5 * t**3 - 0.5 * t**2,
        ],
        axis=1,
    )
    columns = base[:, None] + np.arange(-1, 3)
    row = np.repeat(np.arange(last - first), 4)
    shape = (last - first, nodes)
    return csr_matrix((weights.ravel().astype(np.float32), (row, columns.ravel())), shape=shape)


def expose_band(ground: Ground, maps: PixelMaps, first: int, last: int) -> Field:
    """Light from the ground on the pixels of some rows of the scan, 0 to 255."""
    columns, rows = maps.band(first, last)
    height, width = ground.gray.shape
    left = int(np.clip(np.floor(columns.min()) - 3, 0, width - 1))
    right = int(np.clip(np.ceil(columns.max()) + 4, left + 1, width))
    top = int(np.clip(np.floor(rows.min()) - 3, 0, height - 1))
    bottom = int(np.clip(np.ceil(rows.max()) + 4, top + 1, height))
    part = ground.gray[top:bottom, left:right].astype(np.float32)
    light = cv2.remap(
        part, columns - left, rows - top, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    return np.clip(np.asarray(light, dtype=np.float32), 0.0, 255.0)


class _DarkRoom:
    """Turns light into gray values, band by band."""

    def __init__(self, exposure: Exposure, camera: Camera, seed: int, options: FilmOptions) -> None:
        self.exposure, self.camera, self.seed, self.options = exposure, camera, seed, options
        rng = seeded(seed, "development", exposure.photo_id)
        self.gain = float(np.exp(rng.normal(0.0, 0.09)))
        self.steepness = float(rng.uniform(1.7, 2.2))
        self.fog = float(rng.uniform(6.0, 14.0))
        self.bed = float(rng.uniform(22.0, 48.0))
        self.linear = exposure.pixel_from_film[:, :2]
        self.pixel_mm = 1.0 / float(np.sqrt(abs(np.linalg.det(self.linear))))
        self.uneven = 0.045 * fractal((40, 40), 5.0, 5.0, 60.0, slope=1.0, rng=rng)

    def develop(self, light: Field, first: int) -> Field:
        """Gray values of rows of the scan beginning with the first, from the light on them."""
        x, y = self._film(first, light.shape[0])
        inside = self._frame(x, y)
        gray = self._density(light, x, y, first)
        gray = self.fog + inside * (gray - self.fog)
        for place in self.camera.fiducials_mm.values():
            top, left, dark, mark = mark_coverage(x, y, place, self.pixel_mm, camera=self.camera)
            window = gray[top : top + dark.shape[0], left : left + dark.shape[1]]
            window += dark * (self.fog - window)
            window += mark * (228.0 - window)
        beyond = np.maximum(np.abs(x), np.abs(y)) > np.float32(FILM_MM / 2)
        gray[beyond] = self.bed
        soft = np.asarray(cv2.GaussianBlur(gray, (0, 0), 0.45), dtype=np.float32)
        return np.clip(soft + self._grain(soft, first), 0.0, 255.0)

    def _film(self, first: int, rows: int) -> tuple[Field, Field]:
        """Film x and y, millimetres, of the pixels of a band."""
        back = np.linalg.inv(self.linear)
        shift = self.exposure.pixel_from_film[:, 2]
        column = (np.arange(self.exposure.size_px[0]) + 0.5 - shift[0])[None, :]
        row = (np.arange(first, first + rows) + 0.5 - shift[1])[:, None]
        x = back[0, 0] * column + back[0, 1] * row
        y = back[1, 0] * column + back[1, 1] * row
        return x.astype(np.float32), y.astype(np.float32)

    def _frame(self, x: Field, y: Field) -> Field:
        """Share of each pixel that lies within the camera's frame, its corners a little round."""
        half = np.float32(self.camera.frame_mm[0] / 2), np.float32(self.camera.frame_mm[1] / 2)
        round_mm = np.float32(1.2)
        away_x = np.maximum(np.abs(x) - half[0] + round_mm, 0)
        away_y = np.maximum(np.abs(y) - half[1] + round_mm, 0)
        away = np.hypot(away_x, away_y) - round_mm
        return np.clip(0.5 - away / np.float32(self.pixel_mm), 0.0, 1.0)

    def _density(self, light: Field, x: Field, y: Field, first: int) -> Field:
        """Lens, vignetting, uneven development and the characteristic curve."""
        sharp = cv2.GaussianBlur(light, (0, 0), self.options.blur_px)
        r2 = (x * x + y * y) / np.float32(self.camera.principal_distance_mm**2)
        dose = np.asarray(sharp, dtype=np.float32) / np.float32(255.0)
        dose *= (1.0 + r2) ** np.float32(-self.options.vignetting) * np.float32(self.gain)
        columns, rows = self.exposure.size_px
        dose *= 1.0 + stretched_band(self.uneven, (rows, columns), first, light.shape[0])
        middle = np.float32(0.43)
        rise = np.exp(np.float32(self.steepness) * np.log(np.maximum(dose, 1e-3) / middle))
        return 18.0 + 224.0 * rise / (1.0 + rise)

    def _grain(self, gray: Field, first: int) -> Field:
        """Grain: strongest in the middle tones, alike in neighbouring pixels."""
        name = f"grain {self.exposure.photo_id}"
        noise = white(self.seed, name, 0, first + 4096, gray.shape[1], gray.shape[0])
        blurred = np.asarray(cv2.GaussianBlur(noise, (0, 0), self.options.grain_px))
        # A blurred white field keeps 1 / (2 sqrt(pi) sigma) of its deviation.
        blurred *= np.float32(2.0 * np.sqrt(np.pi) * self.options.grain_px)
        tone = gray / np.float32(255.0)
        return blurred * np.float32(self.options.grain) * (0.35 + 2.6 * tone * (1.0 - tone))


def mark_coverage(
    x: Field, y: Field, place: tuple[float, float], pixel_mm: float, *, camera: Camera
) -> tuple[int, int, Field, Field]:
    """The part of a band that one fiducial covers.

    Args:
        x: Film x of every pixel of the band, millimetres.
        y: Film y of every pixel of the band, millimetres.
        place: The fiducial, film frame, millimetres.
        pixel_mm: Size of a pixel on the film, millimetres.
        camera: The camera, for its frame.

    Returns:
        First row and column of the part, and the share of each of its pixels that the dark tab
        and the bright mark cover; empty where the band does not meet the fiducial.
    """
    rows = np.flatnonzero(np.abs(y - np.float32(place[1])).min(axis=1) < 3 * TAB_MM)
    columns = np.flatnonzero(np.abs(x - np.float32(place[0])).min(axis=0) < 3 * TAB_MM)
    if len(rows) == 0 or len(columns) == 0:
        return 0, 0, np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32)
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    u, v = x[window] - np.float32(place[0]), y[window] - np.float32(place[1])
    arms = np.maximum(_bar(u, v, pixel_mm), _bar(v, u, pixel_mm))
    middle = np.hypot(u, v)
    corner = min(abs(place[0]), abs(place[1])) > 0.3 * camera.frame_mm[0]
    if not corner:
        # Camera of the thirties: broken cross about a dot, on a tab from the side of the frame.
        arms *= 1.0 - _covered(middle - np.float32(GAP_MM), pixel_mm)
        arms = np.maximum(arms, _covered(middle - np.float32(DOT_MM), pixel_mm))
        outward = np.sign(np.round(2.0 * np.array(place) / camera.frame_mm[0]))
        beyond = np.maximum(u * np.float32(outward[0]) + v * np.float32(outward[1]), 0)
        u = u - np.float32(outward[0]) * beyond
        v = v - np.float32(outward[1]) * beyond
    tab = _covered(np.hypot(u, v) - np.float32(TAB_MM), pixel_mm)
    return int(rows[0]), int(columns[0]), tab, arms


def _covered(distance_mm: Field, pixel_mm: float) -> Field:
    """Share of a pixel inside a boundary, from its middle's signed distance to it."""
    return np.clip(0.5 - distance_mm / np.float32(pixel_mm), 0.0, 1.0)


def _bar(along: Field, across: Field, pixel_mm: float) -> Field:
    long = _covered(np.abs(along) - np.float32(ARM_MM), pixel_mm)
    # A line thinner than a pixel covers what its width covers, no more.
    low = np.maximum(across - np.float32(pixel_mm / 2), np.float32(-HALF_WIDTH_MM))
    high = np.minimum(across + np.float32(pixel_mm / 2), np.float32(HALF_WIDTH_MM))
    return long * np.clip((high - low) / np.float32(pixel_mm), 0.0, 1.0)


def draw_margin(
    scan: Picture, exposure: Exposure, camera: Camera, rng: np.random.Generator
) -> None:
    """The printed data strip below the frame and what archivists wrote beside and into it."""
    year, number = exposure.photo_id.split(".")[1], exposure.photo_id.split(".")[-1]
    half = camera.frame_mm[0] / 2
    printed = f"f={camera.principal_distance_mm:.2f}   {year}   {number}   H {_altitude(exposure)}"
    _write(scan, exposure, printed, (-half + 8.0, -half - 4.4), 2.2, 0.0, 205, False)
    day = f"{int(rng.integers(1, 29))}.{('V', 'VI', 'VII', 'VIII')[int(rng.integers(4))]}.{year}"
    place = (float(rng.uniform(-60, 20)), half + 1.6)
    _write(scan, exposure, day, place, 2.8, float(rng.normal(0, 2.5)), 190, True)
    place = (float(rng.uniform(-half + 13, -half + 28)), half - 7.5)
    _write(scan, exposure, str(int(number)), place, 4.5, float(rng.normal(0, 5.0)), 235, True)


def _altitude(exposure: Exposure) -> int:
    return int(round(float(exposure.exterior.centre[2]), -1))


def _write(
    scan: Picture,
    exposure: Exposure,
    text: str,
    place_mm: tuple[float, float],
    height_mm: float,
    turn_deg: float,
    tone: int,
    by_hand: bool,
) -> None:
    """Text whose lower left lies at a film point, turned, in white ink."""
    pixel_mm = _pixel_mm(exposure)
    font = cv2.FONT_HERSHEY_SCRIPT_SIMPLEX if by_hand else cv2.FONT_HERSHEY_PLAIN
    size = height_mm / pixel_mm / (21.0 if by_hand else 10.0)
    thick = max(1, round((0.35 if by_hand else 0.25) / pixel_mm))
    (wide, high), below = cv2.getTextSize(text, font, size, thick)
    ink = np.zeros((high + below + 2 * thick + 4, wide + 2 * thick + 4), dtype=np.uint8)
    cv2.putText(ink, text, (thick, high + thick), font, size, (255,), thick, cv2.LINE_AA)
    reach = int(np.hypot(*ink.shape)) + 4
    matrix = cv2.getRotationMatrix2D((0.0, float(high)), turn_deg, 1.0)
    matrix[:, 2] += np.array([reach / 2, reach / 2 - high])
    turned = np.asarray(cv2.warpAffine(ink, matrix, (2 * reach, reach)))
    column, row = (int(v) for v in exposure.pixels(np.array([place_mm]))[0])
    left, top = column - reach // 2, row - reach // 2
    rows = slice(max(top, 0), min(top + reach, scan.shape[0]))
    columns = slice(max(left, 0), min(left + 2 * reach, scan.shape[1]))
    ink_part = turned[
        rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
    ]
    share = ink_part.astype(np.float32) / 255.0
    part = scan[rows, columns]
    scan[rows, columns] = (part + share * (tone - part.astype(np.float32))).astype(np.uint8)


def draw_scars(scan: Picture, exposure: Exposure, rng: np.random.Generator) -> None:
    """Scratches along the film's way, dust, hairs."""
    pixel_mm = _pixel_mm(exposure)
    for _ in range(int(rng.integers(5, 12))):
        start = rng.uniform(-90.0, 90.0, 2)
        run = np.array([rng.uniform(15.0, 150.0), rng.normal(0.0, 0.6)])
        bend = np.array([0.0, rng.normal(0.0, 0.4)])
        share = np.linspace(0.0, 1.0, 12)[:, None]
        line = start + share * run + share * (1 - share) * 4 * bend
        tone = int(rng.choice([45, 80, 190, 235]))
        _stroke(scan, exposure, line, tone, thick=1)
    for _ in range(int(rng.integers(3, 8))):
        steps = rng.normal(0.0, 0.5, (14, 2)).cumsum(axis=0) * 0.35
        line = rng.uniform(-88.0, 88.0, 2) + steps.cumsum(axis=0) * 0.5
        _stroke(scan, exposure, line, int(rng.choice([25, 240])), thick=1)
    for _ in range(int(rng.integers(90, 200))):
        column, row = exposure.pixels(rng.uniform(-93.0, 93.0, (1, 2)))[0]
        radius = float(np.exp(rng.normal(np.log(0.035), 0.6))) / pixel_mm
        tone = int(rng.choice([15, 40, 225, 250]))
        axes = (max(int(radius), 0), max(int(radius * rng.uniform(0.5, 1.0)), 0))
        cv2.ellipse(
            scan,
            (int(column), int(row)),
            axes,
            float(rng.uniform(0, 180)),
            0.0,
            360.0,
            (tone,),
            -1,
            cv2.LINE_AA,
        )


def _stroke(scan: Picture, exposure: Exposure, line: FilmPoints, tone: int, *, thick: int) -> None:
    pixels = np.round((exposure.pixels(line) - 0.5) * 256.0).astype(np.int32)
    cv2.polylines(scan, [pixels], False, (tone,), thick, cv2.LINE_AA, 8)


def _pixel_mm(exposure: Exposure) -> float:
    """Size of a scan pixel on the film, millimetres."""
    return 1.0 / float(np.sqrt(abs(np.linalg.det(exposure.pixel_from_film[:, :2]))))
