"""What each verb does: parsed arguments in, work done, sentences to the operator."""

import argparse
import webbrowser
from dataclasses import replace
from pathlib import Path

from app.demo import make_demo, tell_truth
from app.desk.inputs import desk_inputs
from app.desk.wiring import open_desk
from app.doctor import examine
from app.new_block import recognise, write_block_toml
from app.placing import open_placing, placeable
from app.project import Project, read_project
from app.run import STAGE_NAMES, Run, RunOptions
from app.terminal import Voice
from core.synthetic.options import SyntheticOptions
from sessions.session import Session


def stage_names() -> tuple[str, ...]:
    """Stages in their order, for `--from` and `--until`."""
    return STAGE_NAMES


def run(given: argparse.Namespace, voice: Voice) -> None:
    """The automatic stages."""
    walked(given.block, voice, RunOptions(given.first, given.last, given.workers))


def walked(block: Path, voice: Voice, options: RunOptions) -> Run:
    """Run a block and return what was made."""
    project = read_project(block)
    with Session.open(project.folder, "gruber") as session:
        walk = Run(project, session, voice, options)
        walk.walk()
    return walk


def new(given: argparse.Namespace, voice: Voice) -> None:
    """Write the `block.toml` of a folder, and say what was recognised and what was not."""
    found = recognise(given.folder)
    path = write_block_toml(found)
    gaps = [f"! Missing: {gap.what}\n  leaves out {gap.leaves_out}" for gap in found.gaps]
    for sentence in (f"{path} written.", "", *found.found, "", *gaps, *found.notes):
        voice.say(sentence)


def review(given: argparse.Namespace, voice: Voice) -> None:
    """The review desk, until Ctrl-C."""
    project = read_project(given.block)
    with Session.open(project.folder, given.operator) as session:
        port, opened = placed_by_hand(project, session, given, voice)
        inputs = desk_inputs(project, session, given.operator, given.host, port)
        with open_desk(replace(inputs, language=given.language)) as desk:
            voice.say(f"The desk is open at {desk.url}  (Ctrl-C closes it; nothing is lost)")
            voice.say(f"Guests, who look and decide nothing: {desk.guest_url}")
            if not given.no_browser and not opened:
                webbrowser.open(desk.url)
            desk.wait()


def placed_by_hand(
    project: Project, session: Session, given: argparse.Namespace, voice: Voice
) -> tuple[int, bool]:
    """Let a block that does not stand be placed by clicks first.

    Returns:
        The port of the desk, and whether a page is open there already.
    """
    found = placeable(project, session)
    if found is None:
        return given.port, False
    with open_placing(project, found, given.host, given.port, given.language) as placing:
        voice.say(
            "No photo of this block is placed on the reference yet. Two points clicked in one"
        )
        voice.say(f"photo place it: {placing.url}  (Ctrl-C closes; what was saved stays)")
        if not given.no_browser:
            webbrowser.open(placing.url)
        placing.wait()
        # The page is still open there, and comes to the desk by itself.
        return placing.port, True


def report(given: argparse.Namespace, voice: Voice) -> None:
    """The accuracy report of the block as it stands; what is not fresh is computed first."""
    walk = walked(given.block, voice, RunOptions(workers=given.workers))
    voice.say(str(walk.session.results / "report.html"))


def demo(given: argparse.Namespace, voice: Voice) -> None:
    """A synthetic block: made, run, compared with its truth, opened."""
    options = SyntheticOptions(given.size, given.epoch, float(given.relief), given.seed)
    make_demo(given.out, options, voice)
    walk = walked(given.out, voice, RunOptions(workers=given.workers))
    tell_truth(given.out, walk.adjusted, voice)
    if given.headless:
        voice.say(f"Results: {walk.session.results}")
        voice.say(f"Review:  gruber review {given.out}")
        return
    given.block = given.out
    review(given, voice)


def doctor(given: argparse.Namespace, voice: Voice) -> None:
    """What this machine, and a block, lack."""
    for finding in examine(given.block):
        voice.say(finding)
