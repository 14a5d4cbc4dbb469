"""The lessons, and the experiments."""

import argparse
import time
import webbrowser
from pathlib import Path

from app.block_toml import folder_of
from app.experiments import EXPERIMENTS, Table, open_ground, truth_of, write_log
from app.found_lessons import find_lessons
from app.teaching import Teacher, open_teaching
from app.terminal import Voice
from ui.web.access import Door
from ui.words.catalogue import Teller


def teach(given: argparse.Namespace, voice: Voice) -> None:
    """The lessons, until Ctrl-C, or only their names, or an experiment."""
    block = given.block or given.earlier
    if given.experiment:
        experiment(given.experiment, folder_of(block or Path("gruber-demo")), voice)
        return
    if block is not None:
        truth_of(folder_of(block))
    found = find_lessons(given.own, None if block is None else folder_of(block))
    if given.list:
        told = Teacher(found).listed(voice.tell.language)["words"]
        for name in found:
            voice.say(voice.tell("teach.line", name=name, title=told[f"lesson.{name}.title"]))
        return
    door = Door(given.host, given.port, given.address)
    with open_teaching(found, door, given.language, hide_truth=given.hide_truth) as page:
        chosen = f"&lesson={given.lesson}" if given.lesson else ""
        url = f"{page.url}{chosen}"
        voice.say(voice.tell("teach.open", url=url))
        hidden = "teach.students.hidden" if given.hide_truth else "teach.students"
        voice.say(voice.tell(hidden, url=f"{page.guest_url}{chosen}"))
        if not given.no_browser:
            webbrowser.open(url)
        page.wait()


def experiment(name: str, folder: Path, voice: Voice) -> None:
    """One experiment of the thesis: its table beside ours, and where its log is."""
    started, title = time.monotonic(), voice.tell(f"experiment.{name}")
    ground = open_ground(folder)
    made = EXPERIMENTS[name](ground, voice.stage(name, name))
    seconds = time.monotonic() - started
    voice.ended(name, name, seconds, title)
    for line in table_lines(made, voice.tell):
        voice.say(line)
    voice.say(voice.tell(f"experiment.{name}.note"))
    log = write_log(folder, ground, made, seconds)
    voice.say(voice.tell("experiment.log", path=str(log)))


def table_lines(table: Table, tell: Teller) -> list[str]:
    """A table in columns: words to the left, figures to the right."""
    head = [tell(f"experiment.column.{name}") for name in table.columns]
    body = [[_cell(one, tell) for one in row] for row in table.rows]
    wide = [max(len(row[i]) for row in [head, *body]) for i in range(len(head))]
    left = [any(isinstance(row[i], str) for row in table.rows) for i in range(len(head))]
    return [
        "  ".join(
            one.ljust(size) if text else one.rjust(size)
            for one, size, text in zip(row, wide, left, strict=True)
        ).rstrip()
        for row in [head, *body]
    ]


def _cell(value: str | float | None, tell: Teller) -> str:
    if isinstance(value, str):
        return tell(f"experiment.{value[1:]}") if value.startswith("@") else value
    whole = value is not None and value == int(value)
    return tell.number(value, ".0f" if whole else ".2f")
