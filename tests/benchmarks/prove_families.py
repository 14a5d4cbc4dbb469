"""Real marks of 23 camera families, each searched by a program that does not know it.

`python -m tests.benchmarks.prove_families FOLDER [--only NAME]`, FOLDER being `camera-families`.
Of each family a disc about every inset's mark is laid upon made film of 60 mm with texture, scanned
at 25 um as the insets are taken to be, at the corner or side where it belongs (`family_insets`):
the composed pictures themselves show the rims of the insets at all four places. First all drawn
kinds of the library that show a mark of this family are taken away; what is then found is found by
other kinds, or because it repeats. Then the mark that the eye is surest of is shown in each group,
and the others are found.

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

import cv2
import numpy as np

from core.geometry.camera import Camera
from core.raster.scan_file import ScanFile, open_scan
from core.scans.constellation import LIBRARY
from core.scans.copies import mark_shown_at, measure_like
from core.scans.fiducials import measure_unknown_fiducials
from core.scans.film_area import FilmArea, detect_film_area
from core.scans.judging import FiducialSet
from core.scans.repeated import with_repeated
from tests.benchmarks.family_insets import (
    BESIDE_MM,
    GROUPS,
    PIXEL_MM,
    Inset,
    common_offset_off,
    insets_of,
    offset_of,
    own_shapes,
    paste_group,
    read_picture,
)
from tests.benchmarks.marks_by_eye import SeenPicture, read_seen
from tests.core.scans.film_maker import Film, make_film, write_gray

CAMERA = Camera("laid", 60.0, (60.0, 60.0))
WITHIN_PX = 1.0
WRONG_PX = 20.0
"""Half a millimetre: what lies further from every mark that an eye saw is none of them."""


@dataclass(frozen=True)
class Laid:
    """One scan, and where its marks are."""

    file: ScanFile
    area: FilmArea
    insets: dict[str, Inset]
    truth: dict[str, tuple[float, float]]


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


def judged(result: FiducialSet, scan: Laid, group: str, shown: str = "") -> Tally:
    """The marks of a scan against the eye's."""
    eyes = {place: inset.mark for place, inset in scan.insets.items() if place != shown}
    marks = {mark.name: mark for mark in result.marks}
    off = {place: offset_of(marks[place], scan.truth[place]) for place in eyes if place in marks}
    own = scan.insets[shown].mark.sure_px if shown else 0.0
    away = {place: float(np.hypot(*value)) for place, value in off.items()}
    doubted = {str(doubt.evidence.get("fiducial")) for doubt in result.doubts}
    wrong = {name for name in marks if name != shown and away.get(name, 1e9) > WRONG_PX}
    near = {place: value for place, value in away.items() if value <= WRONG_PX}
    alike = common_offset_off({place: off[place] for place in near}, group)
    limit = {place: max(WITHIN_PX, float(np.hypot(own, eyes[place].sure_px))) for place in near}
    fits = sum(near[place] < limit[place] for place in near)
    return Tally(
        len(eyes), len(near), sum(v < WITHIN_PX for v in near.values()), fits,
        sum(value < limit[place] for place, value in alike.items()), len(wrong),
        len(wrong - doubted), 1, int(fits == len(eyes)),
        list(near.values()),
    )  # fmt: skip


def lay(path: Path, insets: dict[str, Inset], number: int) -> Laid:
    """Made film with the insets of one group, as a scan."""
    rng = np.random.default_rng([23, number])
    film = Film(
        pixel_mm=PIXEL_MM, noise=0.0, fiducials={}, turn_deg=float(rng.uniform(-1, 1)),
        margin_mm=BESIDE_MM,
    )  # fmt: skip
    make_film(path, film, number)
    gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    _, truth = paste_group(gray, film, insets, insets, rng)
    gray += 3 * rng.standard_normal(gray.shape, dtype=np.float32)
    write_gray(path, np.clip(gray, 0, 255).astype(np.uint8))
    scan = open_scan(path)
    return Laid(scan, detect_film_area(scan, CAMERA, PIXEL_MM), insets, truth)


def of_family(
    folder: Path, name: str, family: SeenPicture, number: int
) -> tuple[Tally, Tally, float]:
    """One family without and with an example, and the seconds that both took."""
    picture = read_picture(folder, name, family.marks)
    insets, own = insets_of(picture, family.marks), own_shapes(family.marks)
    kept = tuple(mark for mark in LIBRARY if mark.shape not in own)
    alone, shown, seconds = Tally(), Tally(), 0.0
    for group, places in GROUPS.items():
        if not set(places) <= set(insets):
            continue
        with TemporaryDirectory() as made:
            scan = lay(Path(made) / f"{name}.tif", {p: insets[p] for p in places}, number)
            began = process_time()
            found = measure_unknown_fiducials(scan.file, CAMERA, PIXEL_MM, scan.area, kept)
            found = with_repeated(scan.file, CAMERA, PIXEL_MM, scan.area, found, kept)
            alone.add(judged(found, scan, group))
            example = min(places, key=lambda place: insets[place].mark.sure_px)
            like = mark_shown_at(scan.file, scan.area, scan.truth[example], PIXEL_MM)
            copies = measure_like(scan.file, CAMERA, PIXEL_MM, scan.area, like)
            shown.add(judged(copies, scan, group, example))
            seconds += process_time() - began
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
        "| median px | wrong (silent) | by example | by example within 1 px "
        "| by example 1 px or as the eye | by example less one offset | by example wrong (silent) "
        "| groups whole | s |\n" + "|---" * 15 + "|\n"
    )
    alone, shown, seconds, whole, families = Tally(), Tally(), 0.0, 0, 0
    for number, (name, family) in enumerate(read_seen()["families"].items()):
        if given.only and name not in given.only:
            continue
        first, second, took = of_family(given.folder, name, family, number)
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
