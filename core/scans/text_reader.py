"""Print read from pictures: lines of text found and recognised by two networks that OpenCV runs.

The networks are those of PP-OCR, which the package rapidocr-onnxruntime brings (Apache-2.0). Only
its files are used: installed with its requirements it would bring another OpenCV along.

Finding follows Liao et al., Real-time Scene Text Detection with Differentiable Binarization (2020):
a map of text shrunk towards its middle line, whose parts are grown again. Recognition follows
Graves et al., Connectionist Temporal Classification (2006), by the best character at each place.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32

from core.doubts import Failure
from core.errors import ProjectError

PACKAGE = "rapidocr_onnxruntime"
REMEDY = "Install the networks with: pip install --no-deps rapidocr-onnxruntime"
Gray = Float32[np.ndarray, "rows columns"]
Scores = Float32[np.ndarray, "places characters"]
TEXT_FROM = 0.3  # source: Liao et al. 2020, section 3.3, and the package's config.yaml (thresh)
"""Value of the map of text from which a cell belongs to one."""
SURE_FROM = 0.5  # source: the package's config.yaml (box_thresh)
"""Mean value of the map below which a part of it is no text."""
GROWTH = 1.6  # source: the package's config.yaml (unclip_ratio)
"""How far a part is grown, in its area over its perimeter."""
STEP_PX = 32  # source: PP-OCR: pictures are halved five times
"""Sides of a picture in which text is sought are multiples of this."""
LINE_PX = 48  # source: PP-OCRv4: height of the lines it was trained on
"""Height of a line that is recognised, pixels."""
WIDTH_STEP_PX = 160  # design: OpenCV plans a network anew for every size; few sizes, little idle
"""Widths of lines are filled up to multiples of this."""
MIDDLE = 127.5  # source: the networks take grays from -1 to 1
"""Gray that means neither black nor white."""
# source: onnx.proto of ONNX: ModelProto.metadata_props is field 14.
PROPERTIES = 14
"""Field of a model that holds its properties."""
# source: Protocol Buffers, Encoding: seven bits a byte, the eighth says that more follow; the kind
# of a field in three bits, 0 a number, 1 and 5 of eight and four bytes, 2 of stated length.
BITS, MORE, KIND = 7, 128, 7
WIDTHS = {1: 8, 5: 4}  # source: the same page, wire types
LEAST_PX = 8.0  # design: digits of fewer pixels cannot be told apart
"""Lower lines are not read, pixels."""
LOOSE = 0.25  # design: half the gap between two lines
"""What is taken beside a line, as a share of its height."""


@dataclass(frozen=True, slots=True)
class TextLine:
    """A line of print."""

    text: str
    """What it says, in ASCII."""
    probability: float
    """Mean of its characters' probabilities, 0 to 1."""
    corners: tuple[tuple[float, float], ...]
    """Its four corners (column, row) in the picture, clockwise from where the text begins."""


@dataclass(frozen=True, slots=True)
class TextReader:
    """Both networks and what the second one's classes stand for."""

    finder: Path
    """ONNX file of the network that finds lines."""
    recogniser: Path
    """ONNX file of the network that reads a line."""

    def lines(self, picture: Gray) -> list[TextLine]:
        """The lines of a picture, each read as it lies and turned by half a circle.

        Whichever way more is read is how all of it lies.

        Args:
            picture: Gray values, 0 to 255; text lies about along its rows.
        """
        boxes = list(self._boxes(picture))
        ways = [[self._read(picture, turned) for turned in _ways(box)] for box in boxes]
        read = [sum(len(pair[k].text) * pair[k].probability ** 2 for pair in ways) for k in (0, 1)]
        way = int(np.argmax(read))
        return [pair[way] for pair in ways if pair[way].text]

    def _boxes(self, picture: Gray) -> Iterator[np.ndarray]:
        """Corners of what looks like a line of text, clockwise from the upper left."""
        rows, columns = (STEP_PX * -(-size // STEP_PX) for size in picture.shape)
        padded = np.zeros((rows, columns), np.float32)
        padded[: picture.shape[0], : picture.shape[1]] = picture
        found = _run(self.finder, padded)[0, 0]
        parts, _ = cv2.findContours(
            (found > TEXT_FROM).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE
        )
        for part in parts:
            (middle, (width, height), angle) = cv2.minAreaRect(part)
            inside = np.zeros(found.shape, np.uint8)
            cv2.drawContours(inside, [part], -1, 1, -1)
            if min(width, height) < 2 or cv2.mean(found, inside)[0] < SURE_FROM:
                continue
            grown = 2 * GROWTH * width * height / (2 * (width + height))
            corners = cv2.boxPoints((middle, (width + grown, height + grown), angle))
            if min(width, height) + grown >= LEAST_PX:
                yield _upright(corners)

    def _read(self, picture: Gray, corners: np.ndarray) -> TextLine:
        """What a line says."""
        width, height = (float(np.linalg.norm(corners[k] - corners[0])) for k in (1, 3))
        columns = max(LINE_PX, round(LINE_PX * width / height))
        filled = WIDTH_STEP_PX * -(-columns // WIDTH_STEP_PX)
        target = np.array([(0, 0), (columns, 0), (columns, LINE_PX), (0, LINE_PX)], np.float32)
        warp = cv2.getPerspectiveTransform(corners.astype(np.float32), target)
        line = np.full((LINE_PX, filled), MIDDLE, np.float32)
        line[:, :columns] = cv2.warpPerspective(
            picture,
            warp,
            (columns, LINE_PX),
            flags=cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
        text, probability = _decoded(_run(self.recogniser, line)[0], characters_of(self.recogniser))
        return TextLine(text, probability, tuple((float(x), float(y)) for x, y in corners))


def installed_reader() -> TextReader | Failure:
    """The networks of the package where it is installed."""
    found = find_spec(PACKAGE)
    folders = found.submodule_search_locations if found is not None else None
    for folder in folders or ():
        models = Path(folder) / "models"
        finders, readers = sorted(models.glob("*_det_*.onnx")), sorted(models.glob("*_rec_*.onnx"))
        if finders and readers:
            return TextReader(finders[-1], readers[-1])
    return Failure("What reads print is not installed.")


def _ways(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A box as it lies, and turned by half a circle."""
    return corners, np.roll(corners, 2, axis=0)


def _upright(corners: np.ndarray) -> np.ndarray:
    """Corners clockwise from the upper left, the long sides as rows."""
    order = np.argsort(np.arctan2(*(corners - corners.mean(axis=0)).T[::-1]), kind="stable")
    box = corners[order]
    if np.linalg.norm(box[1] - box[0]) < np.linalg.norm(box[2] - box[1]):
        box = np.roll(box, -1 if box[1, 1] < box[3, 1] else 1, axis=0)
    return box


def _run(network: Path, gray: Gray) -> Float32[np.ndarray, "..."]:
    """What a network makes of a gray picture."""
    scaled = np.repeat((gray / MIDDLE - 1)[None, None], 3, axis=1).astype(np.float32)
    net = _network(network)
    net.setInput(scaled)
    return np.asarray(net.forward())


@lru_cache(maxsize=2)
def _network(file: Path) -> cv2.dnn.Net:
    try:
        return cv2.dnn.readNetFromONNX(str(file))
    except cv2.error as error:
        raise ProjectError(file, "is no network that OpenCV can run.", REMEDY) from error


def _decoded(scores: Scores, characters: tuple[str, ...]) -> tuple[str, float]:
    """The text of the best character at each place, repetitions and blanks taken out."""
    allowed = np.array([k for k, one in enumerate(characters) if not one or one.isascii()])
    best = allowed[scores[:, allowed].argmax(axis=1)]
    highest = scores[np.arange(len(best)), best]
    text, probabilities, at = "", [], 0
    for label, run in groupby(best.tolist()):
        length = len(list(run))
        if characters[label]:
            text += characters[label]
            probabilities.append(float(highest[at : at + length].max()))
        at += length
    stripped = text.strip()
    return stripped, float(np.mean(probabilities)) if stripped else 0.0


@lru_cache(maxsize=2)
def characters_of(file: Path) -> tuple[str, ...]:
    """What the classes of a recogniser stand for: nothing, its own characters, a blank.

    They stand under `character` among the properties at the end of the ONNX file, field 14 of its
    model, each a pair of name (1) and value (2).

    Raises:
        ProjectError: The file has none.
    """
    for number, value in _fields(file.read_bytes()):
        pair = dict(_fields(value)) if number == PROPERTIES else {}
        if pair.get(1) == b"character":
            return ("", *pair[2].decode("utf-8").split("\n"), " ")
    raise ProjectError(file, "does not say which characters it knows.", REMEDY)


def _fields(message: bytes) -> Iterator[tuple[int, bytes]]:
    """The fields of a message of Protocol Buffers that are strings or messages themselves."""
    at = 0
    while at < len(message):
        tag, at = _varint(message, at)
        kind = tag & KIND
        if kind == 2:
            length, at = _varint(message, at)
            yield tag >> 3, message[at : at + length]
            at += length
        elif kind == 0:
            _, at = _varint(message, at)
        else:
            at += WIDTHS[kind]


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """A number of seven bits a byte, lowest first, and where it ends."""
    value = shift = 0
    while True:
        byte = message[at]
        value |= (byte % MORE) << shift
        at, shift = at + 1, shift + BITS
        if byte < MORE:
            return value, at
