"""To other programs, and from them."""

import argparse
import time
from dataclasses import replace
from pathlib import Path

from app.bring_points import POINT_TABLE, BroughtPoints, bring_points, reading_of, told_lines
from app.exchange import export_block, export_target, import_into
from app.project import read_project
from app.run import Run
from app.terminal import Voice
from app.verbs.run import run_options
from core.errors import ProjectError
from sessions.session import Session


def export(given: argparse.Namespace, voice: Voice) -> None:
    """The block as it stands in the format of another program; adjusted first where need be."""
    project = read_project(given.block)
    with Session.open(project.folder, "gruber") as session:
        export_target(session, given.format, given.out)  # Refused before the block is adjusted.
        walk = Run(project, session, voice, replace(run_options(given), last="adjustment"))
        walk.walk()
        progress = voice.stage("export", "The block for another program")
        began = time.monotonic()
        report = walk.adjusted
        done = export_block(
            session, report.block, report, given.format, given.out,
            pictures=given.pictures, progress=progress, tangent=given.frame == "tangent",
            taken=project.taken,
        )  # fmt: skip
        voice.ended(
            "export", "The block for another program", time.monotonic() - began, str(done.path)
        )
    for note in done.notes:
        voice.say(note)


def bring(given: argparse.Namespace, voice: Voice) -> None:
    """What another program knows, or a table of points, into a block."""
    name, path = given.source
    # What comes in may be what tells where the block lies.
    project = read_project(given.block, brought=True)
    with Session.open(project.folder, given.operator) as session:
        if name == POINT_TABLE:
            reading = reading_of(given.answer)
            tell_points(bring_points(project, session, Path(path), reading), path, voice)
            return
        brought = import_into(project, session, name, Path(path))
    for what, count in brought.counts.items():
        voice.say(voice.tell(f"brought.{what}", count=count))
    if not brought.counts:
        voice.say(voice.tell("brought.nothing"))
    for note in brought.notes:
        voice.say(note)


def tell_points(brought: BroughtPoints, path: Path, voice: Voice) -> None:
    """What came of a table of points.

    Raises:
        ProjectError: A question was left; nothing came in.
    """
    for line in told_lines(brought):
        voice.say(line)
    if brought.recorded is None:
        raise ProjectError(
            path, "no point was taken over.", "Settle what is asked above with --answer."
        )
    voice.say(voice.tell("brought.points", count=len(brought.found.points)))
