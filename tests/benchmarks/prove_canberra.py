"""Ten real scans of five cameras against what an eye reads from them: picture, strip, marks.

`python -m tests.benchmarks.prove_canberra FOLDER [--picture FILE]`, FOLDER holding the frames of
`act-canberra-film`; prints a table, draws what was found as lines (the photos themselves may not be
handed on) and ends with 1 when fewer than nine are right or one is wrong and silent.
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

from core.geometry.camera import Camera
from core.scans.interior_orientation import ScanOrientation, orient_scan

SEEN = {
    "1961_r01_f1": ("right", (-3, 1422), (1441, 14)),
    "1968_r07_f8617": ("right", (4, 1831), (1800, 34)),
    "1972_r01_f85": ("left", (129, 1835), (1885, 9)),
    "1985_r02_f100": ("right", (20, 1854), (1810, 52)),
    "1985_r12_f30": ("right", (42, 1832), (1834, 30)),
    "1985_r13_f44": ("left", (137, 1843), (1935, 45)),
    "1985_r14_f100": ("left", (119, 1827), (1921, 39)),
    "1993_r33_f55": ("right", (1740, 2734), (4429, 35)),
    "1993_r37_f67": ("top", (65, 2900), (2761, 214)),
    "1997_r25_f28": ("bottom", (90, 3675), (3677, 74)),
}
"""Side of the data strip; lower left and upper right corner of the picture (pixels), looked at and
found right in the enlarged scans."""
PIXEL_UM = {"1993": 25400 / 300, "1997": 25400 / 400}
CORNER_MM = 3.0
PANEL_PX = 220


def camera_of(name: str) -> Camera:
    """Nothing but the format is known of these cameras."""
    side = 180.0 if name.startswith("1961") else 230.0
    return Camera("unknown", 152.4, (side, side))


def judge(name: str, found: ScanOrientation, pixel_mm: float) -> tuple[bool, str]:
    """Whether picture, strip and marks are right, and what was told of the marks."""
    strip, lower_left, upper_right = SEEN[name]
    corners = found.area.corners[[0, 2]]
    away = np.abs(corners - np.array([lower_left, upper_right])).max() * pixel_mm
    doubted = any(doubt.kind == "fiducials-not-found" for doubt in found.doubts)
    marks = len(found.fiducials)
    told = f"{marks} marks, {found.fiducials[0].kind}" if marks else "told: none recognised"
    return bool(away < CORNER_MM and found.strip == strip and (marks >= 4 or doubted)), told


def panel(name: str, found: ScanOrientation) -> np.ndarray:
    """The scan, the picture in it, its marks and its data strip as lines."""
    picture = np.full((PANEL_PX + 18, PANEL_PX, 3), 255, np.uint8)
    scale = (PANEL_PX - 4) / max(found.size_px)

    def at(place: np.ndarray) -> tuple[int, int]:
        return round(float(place[0]) * scale) + 1, round(float(place[1]) * scale) + 1

    cv2.rectangle(picture, (1, 1), at(np.array(found.size_px)), (225, 225, 225), -1)
    corners = found.area.corners
    places = np.array([at(corner) for corner in corners])
    cv2.fillPoly(picture, [places], (200, 220, 200))
    cv2.polylines(picture, [places], True, (40, 120, 40), 2, cv2.LINE_AA)
    ends = {"bottom": (0, 1), "right": (1, 2), "top": (2, 3), "left": (3, 0)}
    if found.strip:
        first, second = (places[i] for i in ends[found.strip])
        cv2.line(picture, tuple(first.tolist()), tuple(second.tolist()), (190, 90, 20), 5)
    for mark in found.fiducials:
        place = at(np.array([mark.column, mark.row]))
        cv2.drawMarker(picture, place, (30, 30, 200), cv2.MARKER_CROSS, 13, 2)
    cv2.putText(
        picture, name, (3, PANEL_PX + 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA
    )
    return picture


def main(arguments: list[str] | None = None) -> int:
    """Run the proof; 1 when a promise is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args(arguments)
    panels: list[np.ndarray] = []
    right = 0
    sys.stdout.write("| scan | sides of the picture seen | data strip | marks | right |\n")
    sys.stdout.write("|---|---|---|---|---|\n")
    for name in SEEN:
        pixel_um = PIXEL_UM.get(name[:4], 25400 / 200)
        found = orient_scan(given.folder / f"{name}.jpg", camera_of(name), pixel_um)
        good, told = judge(name, found, pixel_um / 1000)
        right += good
        sys.stdout.write(
            f"| {name} | {len(found.area.seen)} | {found.strip} | {told} "
            f"| {'yes' if good else 'no'} |\n"
        )
        panels.append(panel(name, found))
    if given.picture:
        cv2.imwrite(str(given.picture), np.vstack([np.hstack(panels[:5]), np.hstack(panels[5:])]))
    sys.stdout.write(f"{right} of {len(SEEN)} right\n")
    return int(right < 9)


if __name__ == "__main__":
    sys.exit(main())
