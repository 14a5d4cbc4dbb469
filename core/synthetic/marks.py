"""Everything on a scan that is not landscape: fiducials, notes in the margin, scratches, dust."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from core.arrays import FilmPoints
from core.geometry.camera import Camera
from core.synthetic.flight import Exposure

Field = Float32[np.ndarray, "_ _"]
Picture = UInt8[np.ndarray, "_ _"]
ARM_MM, HALF_WIDTH_MM = 2.4, 0.13
"""Length of an arm of a fiducial from its middle, and half the width of its line."""
GAP_MM, DOT_MM = 0.6, 0.24
"""Radii of the free space about the middle of a fiducial and of the dot in it."""
TAB_MM = 4.0
"""Half the width of the dark tab that carries a fiducial into the picture."""


def mark_coverage(
    x: Field, y: Field, place: tuple[float, float], pixel_mm: float, camera: Camera
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
        _stroke(scan, exposure, line, tone, 1)
    for _ in range(int(rng.integers(3, 8))):
        steps = rng.normal(0.0, 0.5, (14, 2)).cumsum(axis=0) * 0.35
        line = rng.uniform(-88.0, 88.0, 2) + steps.cumsum(axis=0) * 0.5
        _stroke(scan, exposure, line, int(rng.choice([25, 240])), 1)
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


def _stroke(scan: Picture, exposure: Exposure, line: FilmPoints, tone: int, thick: int) -> None:
    pixels = np.round((exposure.pixels(line) - 0.5) * 256.0).astype(np.int32)
    cv2.polylines(scan, [pixels], False, (tone,), thick, cv2.LINE_AA, 8)


def _pixel_mm(exposure: Exposure) -> float:
    """Size of a scan pixel on the film, millimetres."""
    return 1.0 / float(np.sqrt(abs(np.linalg.det(exposure.pixel_from_film[:, :2]))))
