"""The files of COLMAP's sparse model, as text and as binary, without any meaning put to them.

Newer models have rigs and frames too; orientations of images say the same, so those are not read.
"""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from core.arrays import PixelPoints, Position
from core.errors import ExchangeError
from core.formats.records import read_bytes, read_text
from core.formats.xml_files import AGAIN, digits

# source: COLMAP, src/colmap/sensor/models.h: number of each model and of its parameters.
MODELS = {
    "SIMPLE_PINHOLE": (0, 3),
    "PINHOLE": (1, 4),
    "SIMPLE_RADIAL": (2, 4),
    "RADIAL": (3, 5),
    "OPENCV": (4, 8),
    "OPENCV_FISHEYE": (5, 8),
    "FULL_OPENCV": (6, 12),
    "FOV": (7, 5),
    "SIMPLE_RADIAL_FISHEYE": (8, 4),
    "RADIAL_FISHEYE": (9, 5),
    "THIN_PRISM_FISHEYE": (10, 12),
}
"""Number and count of parameters by name."""
NAMES = {number: name for name, (number, _) in MODELS.items()}
"""Names by number."""
# source: COLMAP, doc/format; the greatest number of 64 bits.
NO_POINT = 2**64 - 1
"""A place in an image that belongs to no point, in binary files."""
PLACE = 8  # source: COLMAP, doc/format; after id, quaternion and translation stands the camera.
# source: COLMAP, doc/format: id, camera, counts, colours as laid down there.
CAMERA, IMAGE, POINT, TRACK = "<IiQQ", "<I7dI", "<Q3d3Bd", "<II"
LONGEST_NAME = 4096  # design: no path is longer; a damaged file would be searched to its end.

Camera = tuple[str, tuple[int, int], list[float]]
"""Model, columns and rows, parameters."""


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """One of COLMAP's images."""

    turn: Float64[np.ndarray, "4"]
    """Unit quaternion w, x, y, z: camera from object."""
    shift: Position
    """Translation."""
    camera: int
    """Number of its camera."""
    name: str
    """File name."""
    pixels: PixelPoints
    """Places."""
    points: list[int]
    """Point of each place; -1 where it belongs to none."""


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """One of COLMAP's points."""

    position: Position
    """In the model's coordinates."""
    track: list[tuple[int, int]]
    """Image and number of the place in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """All of it, by number."""

    cameras: dict[int, Camera]
    """Cameras."""
    images: dict[int, Image]
    """Images."""
    points: dict[int, Point]
    """Points."""


def write_text_model(folder: Path, model: Model) -> None:
    """Write the three text files, numbers with all their digits."""
    lines = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for number, (name, (width, height), values) in model.cameras.items():
        lines.append(f"{number} {name} {width} {height} {digits(values)}")
    _write(folder / "cameras.txt", lines)
    lines = [
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "# POINTS2D[] as (X, Y, POINT3D_ID)",
    ]
    for number, one in model.images.items():
        place = digits([*one.turn, *one.shift])
        lines.append(f"{number} {place} {one.camera} {one.name}")
        rays = zip(one.pixels, one.points, strict=True)
        lines.append(" ".join(f"{digits(pixel)} {point}" for pixel, point in rays))
    _write(folder / "images.txt", lines)
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"]
    for number, point in model.points.items():
        track = " ".join(f"{image} {spot}" for image, spot in point.track)
        lines.append(f"{number} {digits(point.position)} {GREY} {GREY} {GREY} 0.0 {track}")
    _write(folder / "points3D.txt", lines)


GREY = 128  # design: points have no colour of their own; the middle of the scale shows anywhere.


def _write(path: Path, lines: Iterable[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def write_binary(folder: Path, model: Model) -> None:
    """Write the three binary files."""
    out = bytearray(struct.pack("<Q", len(model.cameras)))
    for number, (name, size, values) in model.cameras.items():
        out += struct.pack(CAMERA, number, MODELS[name][0], *size)
        out += struct.pack(f"<{len(values)}d", *values)
    (folder / "cameras.bin").write_bytes(out)
    out = bytearray(struct.pack("<Q", len(model.images)))
    for number, one in model.images.items():
        out += struct.pack(IMAGE, number, *one.turn, *one.shift, one.camera)
        out += one.name.encode() + b"\0" + struct.pack("<Q", len(one.points))
        for (column, row), point in zip(one.pixels.tolist(), one.points, strict=True):
            out += struct.pack("<ddQ", column, row, point if point >= 0 else NO_POINT)
    (folder / "images.bin").write_bytes(out)
    out = bytearray(struct.pack("<Q", len(model.points)))
    for number, point in model.points.items():
        out += struct.pack(POINT, number, *point.position.tolist(), GREY, GREY, GREY, 0.0)
        out += struct.pack("<Q", len(point.track))
        for ray in point.track:
            out += struct.pack(TRACK, *ray)
    (folder / "points3D.bin").write_bytes(out)


def read_text_model(folder: Path) -> Model:
    """The three text files.

    Raises:
        ExchangeError: One is missing or damaged; file and line are named.
    """
    cameras: dict[int, Camera] = {}
    for line in _lines(folder / "cameras.txt"):
        if line.words:
            model = line.words[1] if len(line.words) > 1 else ""
            if model not in MODELS:
                raise line.refused()
            size = (line.whole(2), line.whole(3))
            cameras[line.whole(0)] = (model, size, line.floats(4, 4 + MODELS[model][1]))
    found: dict[int, Point] = {}
    for line in _lines(folder / "points3D.txt"):
        if line.words:
            track = [line.whole(spot) for spot in range(8, len(line.words))]
            if len(track) % 2:
                raise line.refused()
            pairs = list(zip(track[::2], track[1::2], strict=True))
            found[line.whole(0)] = Point(np.array(line.floats(1, 4)), pairs)
    return Model(cameras, _text_images(folder / "images.txt"), found)


def _text_images(path: Path) -> dict[int, Image]:
    """Images, two lines each."""
    images: dict[int, Image] = {}
    lines = _lines(path)
    for line in lines:
        if not line.words:
            continue
        # The second line of an image may be empty, and is then that all the same.
        rays = next(lines, None)
        name = " ".join(line.words[PLACE + 1 :])
        if rays is None or len(rays.words) % 3 or not name:
            raise (rays or line).refused()
        count = len(rays.words)
        values = np.array(rays.floats(0, count)).reshape(-1, 3)
        points = [rays.whole(spot) for spot in range(2, count, 3)]
        place = np.array(line.floats(1, PLACE))
        images[line.whole(0)] = Image(
            place[:4], place[4:], line.whole(PLACE), name, values[:, :2], points
        )
    return images


@dataclass(frozen=True, slots=True)
class _Line:
    """A line, taken apart."""

    path: Path
    number: int
    words: list[str]

    def refused(self) -> ExchangeError:
        """An error that names it."""
        return ExchangeError(
            self.path, "Line {number} is not as COLMAP writes it.", AGAIN, number=self.number
        )

    def whole(self, index: int) -> int:
        """A word as a whole number."""
        try:
            return int(self.words[index])
        except (ValueError, IndexError) as error:
            raise self.refused() from error

    def floats(self, first: int, after: int) -> list[float]:
        """Words as finite numbers."""
        try:
            values = [float(word) for word in self.words[first:after]]
        except ValueError as error:
            raise self.refused() from error
        if len(values) != after - first or not np.isfinite(values).all():
            raise self.refused()
        return values


def _lines(path: Path) -> Iterator[_Line]:
    """All lines but comments; empty ones too."""
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.lstrip().startswith("#"):
            yield _Line(path, number, line.split())


def read_binary(folder: Path) -> Model:
    """The three binary files.

    Raises:
        ExchangeError: One is missing, cut off, or of another program.
    """
    file = _Bytes.of(folder / "cameras.bin")
    cameras: dict[int, Camera] = {}
    for _ in range(file.count()):
        number, model, width, height = file.take(CAMERA)
        if model not in NAMES:
            raise file.refused()
        name = NAMES[int(model)]
        values = file.take(f"<{MODELS[name][1]}d")
        cameras[int(number)] = (name, (int(width), int(height)), [float(one) for one in values])
    file = _Bytes.of(folder / "images.bin")
    images: dict[int, Image] = {}
    for _ in range(file.count()):
        number, *place, camera = file.take(IMAGE)
        name = file.word()
        rays = file.array(RAY, file.count())
        pixels = np.column_stack([rays["x"], rays["y"]]).astype(np.float64)
        points = rays["point"].astype(np.int64).tolist()
        if not np.isfinite(pixels).all():
            raise file.refused()
        turn, shift = np.array(place[:4]), np.array(place[4:])
        images[int(number)] = Image(turn, shift, int(camera), name, pixels, points)
    file = _Bytes.of(folder / "points3D.bin")
    found: dict[int, Point] = {}
    for _ in range(file.count()):
        number, *place = file.take(POINT)
        track = file.array(VIEW, file.count())
        pairs = list(zip(track["image"].tolist(), track["spot"].tolist(), strict=True))
        if not np.isfinite(place[:3]).all():
            raise file.refused()
        found[int(number)] = Point(np.array(place[:3]), pairs)
    return Model(cameras, images, found)


RAY = np.dtype([("x", "<f8"), ("y", "<f8"), ("point", "<u8")])
VIEW = np.dtype([("image", "<u4"), ("spot", "<u4")])


class _Bytes:
    """A binary file, read onwards; never past its end."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path, self.content, self.place = path, content, 0

    @staticmethod
    def of(path: Path) -> "_Bytes":
        """A file from its beginning."""
        return _Bytes(path, read_bytes(path))

    def refused(self) -> ExchangeError:
        """An error that names the byte."""
        return ExchangeError(
            self.path, "It is cut off or damaged at byte {place}.", AGAIN, place=self.place
        )

    def take(self, layout: str) -> tuple[float, ...]:
        """Some values."""
        end = self.place + struct.calcsize(layout)
        if end > len(self.content):
            raise self.refused()
        values = struct.unpack_from(layout, self.content, self.place)
        self.place = end
        return values

    def count(self) -> int:
        """How many follow: never more than there are bytes left."""
        number = int(self.take("<Q")[0])
        if number > len(self.content) - self.place:
            raise self.refused()
        return number

    def array(self, layout: np.dtype, number: int) -> np.ndarray:
        """Many alike."""
        end = self.place + number * layout.itemsize
        if end > len(self.content):
            raise self.refused()
        values = np.frombuffer(self.content, layout, number, self.place)
        self.place = end
        return values

    def word(self) -> str:
        """Text up to a nought."""
        end = self.content.find(b"\0", self.place, self.place + LONGEST_NAME)
        if end < 0:
            raise self.refused()
        text = self.content[self.place : end].decode("utf-8", errors="replace")
        self.place = end + 1
        return text
