"""To other programs, and from them."""

import argparse
import time
from dataclasses import replace
from pathlib import Path

from app.bring_points import OpenQuestionsError
from app.exchange import bring_file, export_block, export_target
from app.project import read_project
from app.run import Run
from app.terminal import Voice
from app.verbs.run import run_options
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
        try:
            brought = bring_file(project, session, name, Path(path), given.answer)
        except OpenQuestionsError as asked:
            for line in asked.lines:
                voice.say(line)
            raise
    for what, count in brought.counts.items():
        voice.say(voice.tell(f"brought.{what}", count=count))
    if not brought.counts:
        voice.say(voice.tell("brought.nothing"))
    for note in brought.notes:
        voice.say(note)
