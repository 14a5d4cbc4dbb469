"""Scans into whose margins real mark insets of 23 camera families are pasted.

`python -m tests.benchmarks.prove_pasted_marks FOLDER [--scans 23] [--seed 1] [--only NAME]`,
FOLDER being `camera-families`. Every scan is made film of 60 mm with texture and noise, scanned at
15 to 127 um. At its four corners or sides a disc about a mark of one family is pasted, feathered,
dimmed and turned with the film: in scans with an even number one inset at all four places, turned;
in the others the four insets of the family as they are. In every second round of families the
places of the marks are certified, in the others nothing is known. The dots of their maker are
removed (`family_insets`).

The truth is the place at which the centre read by eye was put. An eye reads it to 0.3 to 3 px of
the inset (8 to 75 um), alike at all copies of one inset: so what is held to 0.2 px or 5 um,
whichever is more, are copies, less one offset alike at all four. Of the family's own four insets
the distance from the eye's centre is held to 1 px of the inset or what the eye is sure to.
"""

import argparse
import sys
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, process_time

import cv2
import numpy as np

from core.geometry.camera import Camera
from core.raster.scan_file import open_scan
from core.scans.copies import mark_shown_at, measure_like
from core.scans.film_area import detect_film_area
from core.scans.interior_orientation import orient_scan
from core.scans.judging import FiducialSet
from tests.benchmarks.family_insets import (
    BESIDE_MM,
    GROUPS,
    PIXEL_MM,
    common_offset_off,
    insets_of,
    offset_of,
    paste_group,
    read_picture,
)
from tests.benchmarks.marks_by_eye import SeenPicture, read_seen
from tests.core.scans.film_maker import Film, make_film, write_gray

PIXELS_UM = (15.0, 20.0, 25.0, 40.0, 60.0, 85.0, 127.0)
WITHIN_PX, WITHIN_MM = 0.2, 0.005
WRONG_MM = 0.5


@dataclass(frozen=True)
class Pasted:
    """One scan."""

    family: str
    group: str
    film: Film
    copied: bool
    certified: bool
    truth: dict[str, tuple[float, float]]
    sure_mm: dict[str, float]


@dataclass
class Tally:
    """Marks of scans, and what became of them."""

    scans: int = 0
    marks: int = 0
    found: int = 0
    right: int = 0
    wrong: int = 0
    silent: int = 0
    seconds: float = 0.0
    off_um: list[float] = field(default_factory=list)

    def add(self, other: "Tally") -> None:
        """Count another in."""
        for name in ("scans", "marks", "found", "right", "wrong", "silent", "seconds"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.off_um += other.off_um


def make_scan(path: Path, number: int, seed: int, folder: Path) -> Pasted:
    """One scan: everything about it follows from its number."""
    rng = np.random.default_rng([seed, number])
    families = read_seen()["families"]
    name = list(families)[number % len(families)]
    family: SeenPicture = families[name]
    insets = insets_of(read_picture(folder, name, family.marks), family.marks)
    groups = [group for group, places in GROUPS.items() if set(places) <= set(insets)]
    group = groups[int(rng.integers(len(groups)))]
    own = {place: insets[place] for place in GROUPS[group]}
    film = Film(
        pixel_mm=float(rng.choice(PIXELS_UM)) / 1000,
        turn_deg=float(rng.uniform(-1.5, 1.5)),
        shrinkage=(1 + float(rng.normal(0, 3e-4)), 1 + float(rng.normal(0, 3e-4))),
        noise=0.0,
        fiducials={},
        margin_mm=BESIDE_MM,
    )
    make_film(path, film, seed * 1000 + number)
    gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    copied = number % 2 == 0
    first = own[GROUPS[group][int(rng.integers(4))]]
    used = {place: first if copied else inset for place, inset in own.items()}
    film_mm, truth = paste_group(gray, film, own, used, rng)
    gray += float(rng.uniform(2, 6)) * rng.standard_normal(gray.shape, dtype=np.float32)
    write_gray(path, np.clip(gray, 0, 255).astype(np.uint8))
    certified = number // len(families) % 2 == 1
    film = Film(**{**film.__dict__, "fiducials": film_mm if certified else {}})
    sure = {place: inset.mark.sure_px * PIXEL_MM for place, inset in used.items()}
    return Pasted(name, group, film, copied, certified, truth, sure)


def judged(scan: Pasted, marks: FiducialSet, seconds: float, shown: str = "") -> Tally:
    """The marks of one scan against where they were put."""
    pixel_mm = scan.film.pixel_mm
    off = {
        mark.name: offset_of(mark, scan.truth[mark.name]) * pixel_mm
        for mark in marks.marks
        if mark.name in scan.truth
    }
    away = {name: float(np.hypot(*value)) for name, value in off.items()}
    near = {name: value for name, value in off.items() if away[name] < WRONG_MM}
    names = [name for name in scan.truth if name != shown]
    limit = max(WITHIN_PX * pixel_mm, WITHIN_MM)
    alike = common_offset_off(near, scan.group)
    if scan.copied:
        right = [name for name in names if alike.get(name, 9.0) < limit]
        worst = [alike.get(name, away[name]) * 1000 for name in names if name in near]
    else:
        own = scan.sure_mm.get(shown, 0.0)
        limits = {n: max(PIXEL_MM, limit, float(np.hypot(own, scan.sure_mm[n]))) for n in names}
        right = [name for name in names if name in near and away[name] < limits[name]]
        worst = [away[name] * 1000 for name in names if name in near]
    wrong = {name for name in away if name not in near}
    wrong |= {mark.name for mark in marks.marks if mark.name not in scan.truth}
    doubted = {str(doubt.evidence.get("fiducial")) for doubt in marks.doubts}
    found = sum(name in near for name in names)
    return Tally(1, len(names), found, len(right), len(wrong), len(wrong - doubted), seconds, worst)


def judge(number: int, seed: int, folder: Path, made: Path) -> tuple[Pasted, Tally, Tally]:
    """Make one scan, find its marks without and with an example."""
    path = made / f"{number}.tif"
    scan = make_scan(path, number, seed, folder)
    camera = Camera("pasted", 60.0, (60.0, 60.0), fiducials_mm=dict(scan.film.fiducials))
    began = process_time()
    oriented = orient_scan(path, camera, scan.film.pixel_mm * 1000)
    alone = judged(scan, FiducialSet(oriented.fiducials, oriented.doubts), process_time() - began)
    opened = open_scan(path)
    area = detect_film_area(opened, camera, scan.film.pixel_mm)
    example = min(scan.truth, key=lambda name: scan.sure_mm[name])
    began = process_time()
    like = mark_shown_at(opened, area, scan.truth[example], scan.film.pixel_mm)
    copies = measure_like(opened, camera, scan.film.pixel_mm, area, like)
    shown = judged(scan, copies, process_time() - began, example)
    path.unlink()
    return scan, alone, shown


def row(name: str, alone: Tally, shown: Tally) -> str:
    """One line of the table."""
    both = [
        f"{t.found} of {t.marks} | {t.right} | "
        f"{np.median(t.off_um) if t.off_um else float('nan'):.0f} | {t.wrong} ({t.silent})"
        for t in (alone, shown)
    ]
    seconds = (alone.seconds + shown.seconds) / max(alone.scans, 1)
    return f"| {name} | {alone.scans} | {both[0]} | {both[1]} | {seconds:.0f} |\n"


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 when a mark is wrong and silent."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scans", type=int, default=23)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=600.0)
    parser.add_argument("--only", nargs="*", default=())
    given = parser.parse_args(arguments)
    tallies: dict[str, tuple[Tally, Tally]] = defaultdict(lambda: (Tally(), Tally()))
    families, until = list(read_seen()["families"]), monotonic() + 60 * given.minutes
    with TemporaryDirectory() as made:
        for number in range(given.scans):
            if monotonic() > until:
                break
            if given.only and families[number % len(families)] not in given.only:
                continue
            scan, alone, shown = judge(number, given.seed, given.folder, Path(made))
            how = "copies" if scan.copied else "own insets"
            how += ", certified" if scan.certified else ""
            for key in (scan.family, how, "all"):
                tallies[key][0].add(alone)
                tallies[key][1].add(shown)
            um = scan.film.pixel_mm * 1000
            sys.stderr.write(
                f"{number} {scan.family} {scan.group} {um:.0f} um, {how}: "
                f"{alone.right}/{alone.found}/{alone.marks}, {alone.silent} silent, "
                f"{shown.right}/{shown.found}/{shown.marks}, {shown.silent} silent, "
                f"{alone.seconds:.0f} + {shown.seconds:.0f} s\n"
            )
            sys.stderr.flush()
    sys.stdout.write(
        "| family | scans | found | right | median um | wrong (silent) | by example "
        "| by example right | by example median um | by example wrong (silent) | s a scan |\n"
        + "|---" * 11
        + "|\n"
    )
    order = [*families, *sorted(key for key in tallies if key not in (*families, "all")), "all"]
    for key in order:
        if key in tallies:
            sys.stdout.write(row(key, *tallies[key]))
    return int(tallies["all"][0].silent + tallies["all"][1].silent > 0)


if __name__ == "__main__":
    sys.exit(main())
