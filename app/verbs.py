"""What each verb does: parsed arguments in, work done, sentences to the operator."""

import argparse
from pathlib import Path

from app.new_block import recognise, write_block_toml
from app.project import read_project
from app.run import STAGE_NAMES, Run, RunOptions
from app.terminal import Voice
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
    """Write the `block.toml` of a folder."""
    found = recognise(given.folder)
    path = write_block_toml(found)
    voice.say(f"{path} written.")
    for sentence in (*found.found, *found.gaps, *found.notes):
        voice.say(str(sentence))


def review(given: argparse.Namespace, voice: Voice) -> None:
    """The review desk."""


def report(given: argparse.Namespace, voice: Voice) -> None:
    """The accuracy report."""


def demo(given: argparse.Namespace, voice: Voice) -> None:
    """A synthetic block."""


def doctor(given: argparse.Namespace, voice: Voice) -> None:
    """What is lacking."""
