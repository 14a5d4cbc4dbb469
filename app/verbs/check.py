"""Places at which the mosaic is checked, a sample of its sheets, its rules, and its neighbours."""

import argparse
import time

from app.check_plan import PlanWish, plan_checks
from app.check_plan import told_lines as told_plan
from app.job_rules import rules_lines
from app.neighbours import archive_of
from app.neighbours_told import told_lines as neighbour_lines
from app.project import read_project
from app.run import Run, RunOptions
from app.sheet_sample import draw_sample
from app.sheet_sample import told_lines as told_sample
from app.terminal import Voice, interruptible
from sessions.session import Session


def check(given: argparse.Namespace, voice: Voice) -> None:
    """A plan of places to be checked; the block is run as far as it takes to know its ground.

    Or a sample of its map sheets, or the rules in force, as a file to edit, or the blocks of a
    folder compared with one another.
    """
    if given.what == "neighbours":
        compare_neighbours(given, voice)
        return
    project = read_project(given.block)
    if given.what == "rules":
        for line in rules_lines(project.rules):
            voice.say(line)
        return
    with Session.open(project.folder, given.operator) as session:
        if given.what == "sheets":
            sample = draw_sample(project, session, given.seed)
            session.record(sample)
            for line in told_sample(sample, project.rules):
                voice.say(line)
            return
        if session.products.latest_value("georeference") is None:
            Run(project, session, voice, RunOptions(last="georeference")).walk()
        began, title = time.monotonic(), "Places to be checked"
        progress = voice.stage("check", title)
        wish = PlanWish(given.cells, 1 if given.seed is None else given.seed, given.points)
        made = plan_checks(project, session, wish, progress)
        voice.ended("check", title, time.monotonic() - began, "")
    for line in told_plan(made):
        voice.say(line)


def compare_neighbours(given: argparse.Namespace, voice: Voice) -> None:
    """What the blocks of a folder share, and whether it differs by more than is predicted."""
    began, title = time.monotonic(), "Neighbouring blocks"
    archive = archive_of(given.block)
    with interruptible() as interruption:
        figures = archive.figures(interruption.watching(voice.stage("neighbours", title)))
    voice.ended("neighbours", title, time.monotonic() - began, str(given.block))
    for line in neighbour_lines(figures):
        voice.say(line)
    voice.figures("neighbours", figures)
