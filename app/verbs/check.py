"""A plan of places at which the mosaic is checked, and the rules it is judged by."""

import argparse
import time

from app.check_plan import PlanWish, plan_checks
from app.check_plan import told_lines as told_plan
from app.job_rules import rules_lines
from app.project import read_project
from app.run import Run, RunOptions
from app.terminal import Voice
from sessions.session import Session


def check(given: argparse.Namespace, voice: Voice) -> None:
    """A plan of places to be checked; the block is run as far as it takes to know its ground.

    Or the rules in force, as a file to edit.
    """
    project = read_project(given.block)
    if given.what == "rules":
        for line in rules_lines(project.rules):
            voice.say(line)
        return
    with Session.open(project.folder, given.operator) as session:
        if session.products.latest_value("georeference") is None:
            Run(project, session, voice, RunOptions(last="georeference")).walk()
        began, title = time.monotonic(), "Places to be checked"
        progress = voice.stage("check", title)
        wish = PlanWish(given.cells, given.seed, given.points)
        made = plan_checks(project, session, wish, progress)
        voice.ended("check", title, time.monotonic() - began, "")
    for line in told_plan(made):
        voice.say(line)
