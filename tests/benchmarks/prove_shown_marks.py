"""Marks of real film by themselves and from one example, against places read by eye before.

`python -m tests.benchmarks.prove_shown_marks FOLDER [--only NAME]`, FOLDER holding the frames of
`act-canberra-film`. Marks of corners and of sides are groups of their own. Every mark that could be
read is shown once, and the others of its group are sought. A mark stands where no doubt names it;
it is wrong where it stands further off than the eye may be. Ends with 1 where any is wrong.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.doubts import Doubt
from core.scans.copies import mark_shown_at, measure_like
from core.scans.interior_orientation import orient_scan
from core.scans.judging import FiducialMeasurement
from core.scans.naming import CORNERS, SIDES
from tests.benchmarks.marks_by_eye import SeenMark, read_seen
from tests.benchmarks.prove_canberra import PIXEL_UM, camera_of

GOAL_PX = 1.0
"""An eye reads marks of these coarse scans to about half of this."""


@dataclass
class Tally:
    """How many marks were found where the eye has them, doubted, wrong and silent, or not found."""

    near: int = 0
    doubted: int = 0
    wrong: int = 0
    missed: int = 0

    def count(
        self,
        found: Sequence[FiducialMeasurement],
        doubts: Sequence[Doubt],
        wanted: Mapping[str, SeenMark],
    ) -> None:
        """Judge the marks of one search."""
        doubted = {str(doubt.evidence.get("fiducial")) for doubt in doubts}
        measured = {mark.name: mark for mark in found}
        for name, eye in wanted.items():
            mark = measured.get(name)
            if mark is None:
                self.missed += 1
            elif np.hypot(mark.column - eye.column, mark.row - eye.row) <= max(
                GOAL_PX, 2 * eye.sure_px
            ):
                self.near += 1
            elif name in doubted:
                self.doubted += 1
            else:
                self.wrong += 1

    def add(self, other: "Tally") -> None:
        """Count another in."""
        for name in ("near", "doubted", "wrong", "missed"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def __str__(self) -> str:
        return f"{self.near} | {self.doubted} | {self.missed} | {self.wrong}"


def main(arguments: list[str] | None = None) -> int:
    """Run the proof; 1 where a mark is wrong and nothing says so."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", default=())
    given = parser.parse_args(arguments)
    write = sys.stdout.write
    write("| frame | marks | read | near | doubted | missed | wrong ")
    write("| shown: near | shown: doubted | shown: missed | shown: wrong |\n")
    write("|---" * 11 + "|\n")
    read, all_alone, all_shown = 0, Tally(), Tally()
    for frame, picture in read_seen()["frames"].items():
        if given.only and frame not in given.only:
            continue
        pixel_um, camera = PIXEL_UM.get(frame[:4], 25400 / 200), camera_of(frame)
        own = orient_scan(given.folder / f"{frame}.jpg", camera, pixel_um)
        for group, places in (("corners", CORNERS), ("sides", SIDES)):
            seen = {mark.name: mark for mark in picture.marks if mark.name in places}
            alone, shown = Tally(), Tally()
            alone.count(own.fiducials, own.doubts, seen)
            for name, mark in seen.items():
                place, pixel_mm = (mark.column, mark.row), pixel_um / 1000
                example = mark_shown_at(own.scan, own.area, place, pixel_mm)
                copies = measure_like(own.scan, camera, pixel_mm, own.area, example)
                others = {other: eye for other, eye in seen.items() if other != name}
                shown.count(copies.marks, copies.doubts, others)
            read += len(seen)
            all_alone.add(alone)
            all_shown.add(shown)
            write(f"| {frame} | {group} | {len(seen)} | {alone} | {shown} |\n")
            sys.stdout.flush()
    write(f"| all | | {read} | {all_alone} | {all_shown} |\n")
    return int(all_alone.wrong + all_shown.wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
