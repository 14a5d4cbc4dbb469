"""Georeferences repaired without a click: blocks whose sources are far off, against their truth.

Every block is run twice, from spoilt sources and from good ones. Printed: how far off the sources
were, and the photos at the end of both runs, RMS on the ground. Ends with 1 when fewer than 95 % of
the photos are placed within 10 m, or one is wrong and nobody said so.

`--film FOLDER` spoils the world files of a real block with a true ortho instead: 100 to 300 m off,
turned, 2 % too large or small, and skew; and compares the mosaics of both runs.
"""

import argparse
import contextlib
import io
import shutil
import sys
import tempfile
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning

from app.cli import main as gruber
from core.block import Block
from core.formats.world_file import read_world_file, write_world_file
from core.mosaic.comparison import compare_orthos
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import judge_orientations, read_truth
from sessions.session import Session

KINDS = ("bad world files", "footprints", "positions only")
RELIEFS = (20.0, 60.0, 200.0)
WITHIN_M = 10.0


@dataclass(frozen=True)
class Outcome:
    """One block: ground errors by photo, metres; NaN where a photo was left out."""

    before: np.ndarray
    after: np.ndarray
    told: np.ndarray
    m_p: float
    seconds: float
    """By the clock, all stages up to the adjustment."""


def options_of(number: int, size: str) -> tuple[str, SyntheticOptions]:
    """Kind of source and landscape of the numbered block."""
    kind = KINDS[number % len(KINDS)]
    early = number // len(KINDS) % 2 == 0
    options = SyntheticOptions(
        size=size,  # type: ignore[arg-type]
        epoch=1938 if early else 1984,
        relief_m=RELIEFS[number // 2 % len(RELIEFS)],
        seed=100 + number,
        georeference={"bad world files": "world-file", "footprints": "footprints"}.get(
            kind, "exterior"
        ),
        georeference_quality="bad" if kind == "bad world files" else "good",
        change=(None, 0.5, 0.15)[number % 7 % 3],
    )
    return kind, options


def without_angles(folder: Path, rng: np.random.Generator) -> None:
    """Leave nothing of the EO list but positions, a hundred metres off."""
    rows = (folder / "eo.csv").read_text(encoding="utf-8").splitlines()
    names = rows[0].split(",")
    keep = [names.index(name) for name in ("scan", "X", "Y", "Z")]
    lines = ["scan,X,Y,Z,sigma_X,sigma_Y,sigma_Z"]
    for row in rows[1:]:
        scan, *centre = (row.split(",")[i] for i in keep)
        off = np.array([float(value) for value in centre]) + rng.normal(size=3) * [100, 100, 30]
        lines.append(",".join([scan, *(f"{value:.2f}" for value in off), "100", "100", "30"]))
    (folder / "eo.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def ground_m(block: Block, folder: Path) -> np.ndarray:
    """Ground error of every photo, NaN for those that are not oriented."""
    judged = judge_orientations(read_truth(folder), block)
    found = dict(zip(judged.photo_ids, judged.ground_m, strict=True))
    return np.array([found.get(name, np.nan) for name in sorted(block.photos)])


def run(options: SyntheticOptions, positions: bool, folder: Path) -> Outcome:
    """Make a block, run it up to the adjustment, judge it."""
    make_block(folder, options)
    if positions:
        without_angles(folder, np.random.default_rng(options.seed))
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        started = perf_counter()
        code = gruber(["run", str(folder), "--until", "adjustment"])
        seconds = perf_counter() - started
    with Session.open(folder, "prover") as session:
        start = session.products.latest_value("georeference").block
        assembly = session.products.latest_value("control") if code == 0 else None
        found = session.products.latest_value("localisation") if code == 0 else None
    begun = start.with_photos(
        {name: replace(photo, oriented=True) for name, photo in start.photos.items()}
    )
    before = ground_m(begun, folder)
    if assembly is None:
        nothing = np.full(len(before), np.nan)
        return Outcome(before, nothing, np.ones(len(before), bool), np.nan, seconds)
    block = assembly.report.block
    told = {doubt.subject for doubt in (*found.doubts, *assembly.doubts) if doubt.gravity >= 0.5}
    after = ground_m(block, folder)
    flagged = np.array([name in told or "block" in told for name in sorted(block.photos)])
    return Outcome(before, after, flagged, float(np.sqrt(np.nanmean(after**2))), seconds)


def spoil_world_files(folder: Path, rng: np.random.Generator) -> None:
    """Move, turn, scale and skew the world file of every scan, about the middle of its photo."""
    for path in sorted((folder / "scans").glob("*.tfw")):
        matrix = read_world_file(path).object_from_pixel
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path.with_suffix(".tif")) as scan:
                middle = np.array([scan.width / 2, scan.height / 2])
        turn, way = rng.normal(0, np.radians(1.0)), rng.uniform(0, 2 * np.pi)
        wrong = (1 + rng.normal(0, 0.02)) * np.array(
            [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        )
        wrong[0, 1] += rng.normal(0, 0.01)
        linear = wrong @ matrix[:, :2]
        ground = matrix[:, :2] @ middle + matrix[:, 2]
        ground += rng.uniform(100, 300) * np.array([np.cos(way), np.sin(way)])
        write_world_file(path, np.column_stack([linear, ground - linear @ middle]))


def film_block(source: Path, seed: int) -> int:
    """The real block from its own world files and from spoilt ones."""
    folder = Path(tempfile.mkdtemp(prefix="repair-"))
    accuracies: list[float] = []
    for kind in ("as it is", "world files spoilt"):
        place = folder / kind.replace(" ", "-")
        shutil.copytree(source, place)
        if kind != "as it is":
            spoil_world_files(place, np.random.default_rng(seed))
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            code = gruber(["run", str(place)])
        if code:
            say(f"{source.name}, {kind}: gruber run ended with {code}")
            return 1
        with Session.open(place, "prover") as session:
            photos = session.products.latest_value("control").report.block.photos.values()
        accuracy = compare_orthos(place / "results/mosaic.tif", place / "truth/archival_ortho.tif")
        accuracies.append(accuracy.m_p)
        standing = sum(photo.oriented for photo in photos)
        say(f"{source.name}, {kind}: {standing} of {len(photos)} photos, m_p {accuracy.m_p:.3f} m")
    shutil.rmtree(folder)
    return int(accuracies[1] > 1.05 * accuracies[0])


def compared(ends: np.ndarray) -> str:
    """How blocks from spoilt sources end beside the same blocks from good ones, in one line."""
    ends = ends[np.isfinite(ends).all(axis=1)]
    ratio = ends[:, 0] / ends[:, 1]
    rms = np.sqrt(np.mean(ends**2, axis=0))
    return (
        f"beside good files: {np.median(ratio):.2f} times as far off in the median, "
        f"{ratio.max():.2f} at most, RMS {rms[0]:.2f} m and {rms[1]:.2f} m; "
        f"{int(np.sum(np.abs(ratio - 1) <= 0.05))} of {len(ratio)} within 5 %"
    )


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> int:
    """Prove it on so many blocks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--blocks", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--size", default="tiny")
    parser.add_argument("--strips", type=int, default=2)
    parser.add_argument("--photos", type=int, default=3, help="of each strip")
    parser.add_argument("--film", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.film:
        return film_block(given.film, given.seed)
    placed = wrong = photos = 0
    ends: list[tuple[float, float]] = []
    say("| block | source | epoch | relief | before | after | from good files | placed | time |")
    say("|---|---|---|---|---|---|---|---|---|")
    for number in range(given.first, given.blocks):
        kind, options = options_of(number, given.size)
        options = replace(options, strips=given.strips, photos_per_strip=given.photos)
        good = replace(options, georeference="world-file", georeference_quality="good")
        folder = Path(tempfile.mkdtemp(prefix="repair-"))
        spoilt = run(options, kind == "positions only", folder / "spoilt")
        sound = run(good, False, folder / "good")
        shutil.rmtree(folder)
        photos += len(spoilt.after)
        near = spoilt.after <= WITHIN_M
        placed += int(near.sum())
        silent = int((~near & np.isfinite(spoilt.after) & ~spoilt.told).sum())
        wrong += silent
        ends.append((spoilt.m_p, sound.m_p))
        before_m = np.sqrt(np.mean(spoilt.before**2))
        say(
            f"| {number} | {kind} | {options.epoch} | {options.relief_m:.0f} m | "
            f"{before_m:.1f} m | {spoilt.m_p:.2f} m | {sound.m_p:.2f} m | "
            f"{int(near.sum())} of {len(near)}, {silent} silent | {spoilt.seconds:.0f} s |"
        )
    say(compared(np.array(ends)))
    share = placed / max(photos, 1)
    said = f"{placed} of {photos} photos ({share:.1%}) within {WITHIN_M:.0f} m"
    say(f"{said}; {wrong} wrong and silent")
    return 0 if share >= 0.95 and not wrong else 1


if __name__ == "__main__":
    sys.exit(main())
