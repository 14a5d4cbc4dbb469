"""Real marks of 23 camera families, each searched by a program that does not know it.

`python -m tests.benchmarks.prove_families FOLDER [--only NAME]`, FOLDER being `camera-families`.
Each composed picture is taken as the scan of a little frame at whose corners and sides the insets
stand, without the dots of its maker (see `family_insets`). First all drawn kinds of the library
that show a mark of this family are taken away; what is then found is found by other kinds, or
because it repeats. Then the mark that the eye is surest of is shown in each group, and the others
are found.

Judged by centres that an eye read beforehand (`marks_by_eye`), good to 0.3 to 3 px themselves:
within 1 px; within 1 px or what the eye is sure to; and within 1 px once one offset, alike at all
marks of the group, is taken away: which point of an unlisted figure is its mark is free.
"""

import argparse
import sys
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np

from core.raster.scan_file import ScanFile, open_scan
from core.scans.constellation import LIBRARY
from core.scans.copies import measure_like, shown_in
from core.scans.fiducials import measure_unknown_fiducials
from core.scans.judging import FiducialSet
from core.scans.repeated import with_repeated
from tests.benchmarks.family_insets import (
    GROUPS,
    PIXEL_MM,
    PLACES,
    common_offset_off,
    composed_area,
    composed_camera,
    offset_of,
    own_shapes,
    read_picture,
)
from tests.benchmarks.marks_by_eye import SeenMark, SeenPicture, read_seen
from tests.core.scans.film_maker import write_gray

WITHIN_PX = 1.0
WRONG_PX = 20.0
"""Half a millimetre: what lies further from every mark that an eye saw is none of them."""


@dataclass
class Tally:
    """How many marks were sought, and what became of them."""

    sought: int = 0
    found: int = 0
    within: int = 0
    as_eye: int = 0
    alike: int = 0
    wrong: int = 0
    silent: int = 0
    groups: int = 0
    whole: int = 0
    offsets: list[float] = field(default_factory=list)

    def add(self, other: "Tally") -> None:
        """Count another in."""
        for name in ("sought", "found", "within", "as_eye", "alike", "wrong", "silent", "groups",
                     "whole"):  # fmt: skip
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.offsets += other.offsets


def judged(
    result: FiducialSet, seen: dict[str, SeenMark], group: str, shown: SeenMark | None = None
) -> Tally:
    """The marks of one group against the eye's."""
    eyes = {place: seen[place] for place in GROUPS[group] if place in seen}
    if shown is not None:
        eyes = {place: eye for place, eye in eyes.items() if eye is not shown}
    marks = {mark.name: mark for mark in result.marks if mark.name in GROUPS[group]}
    off = {
        place: offset_of(marks[place], (eye.column, eye.row))
        for place, eye in eyes.items()
        if place in marks
    }
    own = shown.sure_px if shown is not None else 0.0
    away = {place: float(np.hypot(*value)) for place, value in off.items()}
    doubted = {str(doubt.evidence.get("fiducial")) for doubt in result.doubts}
    wrong = {name for name in marks if name in eyes and away[name] > WRONG_PX}
    if not eyes:
        wrong |= set(marks)
    near = {place: value for place, value in away.items() if value <= WRONG_PX}
    alike = common_offset_off({place: off[place] for place in near}, group)
    limit = {place: max(WITHIN_PX, float(np.hypot(own, eyes[place].sure_px))) for place in near}
    fits = sum(near[place] < limit[place] for place in near)
    return Tally(
        len(eyes), len(near), sum(v < WITHIN_PX for v in near.values()), fits,
        sum(value < limit[place] for place, value in alike.items()), len(wrong),
        len(wrong - doubted), int(bool(eyes)), int(bool(eyes) and fits == len(eyes)),
        list(near.values()),
    )  # fmt: skip


def unknown(scan: ScanFile, picture: np.ndarray, family: SeenPicture) -> FiducialSet:
    """What is found by a program that knows none of the family's kinds."""
    own = own_shapes(family.marks)
    kept = tuple(mark for mark in LIBRARY if mark.shape not in own)
    camera, area = composed_camera(), composed_area(picture)
    found = measure_unknown_fiducials(scan, camera, PIXEL_MM, area, kept)
    return with_repeated(scan, camera, PIXEL_MM, area, found)


def of_family(folder: Path, name: str, family: SeenPicture) -> tuple[Tally, Tally, float]:
    """One family without and with an example, and the seconds that both took."""
    seen = {PLACES[mark.name]: mark for mark in family.marks}
    picture = read_picture(folder, name, family.marks)
    camera, area = composed_camera(), composed_area(picture)
    alone, shown = Tally(), Tally()
    with TemporaryDirectory() as made:
        path = Path(made) / f"{name}.tif"
        write_gray(path, picture)
        scan = open_scan(path)
        began = process_time()
        result = unknown(scan, picture, family)
        for group, places in GROUPS.items():
            alone.add(judged(result, seen, group))
            given = [seen[place] for place in places if place in seen]
            if not given:
                continue
            example = min(given, key=lambda mark: mark.sure_px)
            place = example.column, example.row
            like = shown_in(scan, area, place, PIXEL_MM)
            copies = measure_like(scan, camera, PIXEL_MM, area, like)
            shown.add(judged(copies, seen, group, example))
        seconds = process_time() - began
    return alone, shown, seconds


def row(name: str, away: str, alone: Tally, shown: Tally, seconds: float) -> str:
    """One line of the table."""
    worst = f"{np.median(alone.offsets):.1f}" if alone.offsets else "-"
    return (
        f"| {name} | {away} | {alone.found} of {alone.sought} | {alone.within} | {alone.as_eye} "
        f"| {alone.alike} | {worst} | {alone.wrong} ({alone.silent}) "
        f"| {shown.found} of {shown.sought} | {shown.within} | {shown.as_eye} | {shown.alike} "
        f"| {shown.wrong} ({shown.silent}) | {shown.whole} of {shown.groups} | {seconds:.0f} |\n"
    )


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 when a mark is wrong and silent."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", default=())
    given = parser.parse_args(arguments)
    sys.stdout.write(
        "| family | kinds taken away | found | within 1 px | 1 px or as the eye | less one offset "
        "| median px | wrong (silent) | by one example | within 1 px | 1 px or as the eye "
        "| less one offset | wrong (silent) | groups whole | s |\n" + "|---" * 15 + "|\n"
    )
    alone, shown, seconds, whole, families = Tally(), Tally(), 0.0, 0, 0
    for name, family in read_seen()["families"].items():
        if given.only and name not in given.only:
            continue
        first, second, took = of_family(given.folder, name, family)
        away = ", ".join(sorted(own_shapes(family.marks))) or "none shows it"
        sys.stdout.write(row(name, away, first, second, took))
        sys.stdout.flush()
        alone.add(first)
        shown.add(second)
        seconds, families = seconds + took, families + 1
        whole += second.whole == second.groups
    sys.stdout.write(row("all", "", alone, shown, seconds))
    sys.stdout.write(
        f"without example {100 * alone.as_eye / alone.sought:.0f} % (asked 80), less one offset "
        f"{100 * alone.alike / alone.sought:.0f} %; by one example all others in {whole} of "
        f"{families} families (asked all)\n"
    )
    return int(alone.silent + shown.silent > 0)


if __name__ == "__main__":
    sys.exit(main())
