"""A synthetic block, run and compared with its truth."""

import argparse
import time
from pathlib import Path

import numpy as np

from app.epochs import Epoch
from app.runners import run_block
from app.terminal import Voice
from app.verbs.review import review
from app.verbs.run import run_options
from core.adjustment.adjusted import AdjustmentReport
from core.errors import StorageError
from core.mosaic.comparison import compare_orthos
from core.said import say
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import judge_control, judge_orientations, read_truth
from sessions.atomic_write import whole_file
from sessions.disk import explain_disk_errors
from sessions.products import digest_of

STAMP = ".demo"


def demo(given: argparse.Namespace, voice: Voice) -> None:
    """A synthetic block: made, run, compared with its truth, opened."""
    options = SyntheticOptions(given.size, given.epoch, float(given.relief), given.seed)
    make_demo(given.out, options, voice)
    walk = run_block(given.out, voice, run_options(given))
    tell_truth(given.out, walk.adjusted, voice)
    if given.headless:
        voice.say(say("Results: {folder}", folder=str(walk.session.results)))
        voice.say(say("Review:  gruber review {folder}", folder=str(given.out)))
        return
    given.block = given.out
    review(given, voice)


def make_demo(folder: Path, options: SyntheticOptions, voice: Voice) -> None:
    """Make the block, unless this very block is there already.

    Raises:
        StorageError: The folder holds something else, or cannot be written.
    """
    stamp, digest = folder / STAMP, digest_of("demo", 1, options)
    if stamp.is_file():
        if stamp.read_text(encoding="utf-8") == digest:
            return
        raise StorageError(
            folder,
            "holds a demo block with other options.",
            "Give another folder with --out, or remove this one.",
        )
    if folder.is_dir() and (folder / "block.toml").exists():
        raise StorageError(
            folder, "holds a block that is not a demo.", "Give another folder with --out."
        )
    started = time.monotonic()
    progress = voice.stage("make", "A landscape, a flight, film")
    with explain_disk_errors(folder):
        make_block(folder, options, progress)
    with whole_file(stamp) as temporary:
        temporary.write_text(digest, encoding="utf-8")
    voice.ended("make", "A landscape, a flight, film", time.monotonic() - started, str(folder))


def tell_truth(folder: Path, report: AdjustmentReport, voice: Voice) -> None:
    """Compare a demo's results with the truth that was put in, and say so in a table."""
    for line in truth_lines(folder, report):
        voice.say(line)


def truth_lines(folder: Path, report: AdjustmentReport) -> list[str]:
    """The comparison with truth, a line for each figure."""
    truth = read_truth(folder)
    control = judge_control(truth, report.block)
    photos = judge_orientations(truth, report.block)
    mosaic = compare_orthos(Epoch(folder).mosaic, folder / "truth" / "archival_ortho.tif")
    oriented = sum(photo.oriented for photo in report.block.photos.values())
    ground = float(np.sqrt(np.mean(np.square(photos.ground_m))))
    return [
        "",
        "Against the truth that was put in",
        f"  photos oriented          {oriented} of {len(report.block.photos)}",
        f"  mosaic m_p               {mosaic.m_p:.2f} m  "
        f"(m_X {mosaic.m_x:.2f}, m_Y {mosaic.m_y:.2f}, {mosaic.n} places)",
        f"  orientation, on ground   {ground:.2f} m rms over the frames",
        f"  control measurements     {control.used} used, "
        f"{100 * control.wrong_share:.1f} % wrong (more than 3 m off)",
        f"  sigma nought             {report.sigma_nought:.2f}",
        "",
    ]
