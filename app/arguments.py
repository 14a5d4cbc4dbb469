"""The arguments of each verb, and what it is for.

What a verb needs for its arguments is imported once it is asked for, as in `app.cli`.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from app.argument_values import grid_size, metres, operator_name, proxy_address, whole_number
from app.settings import Settings
from app.usage import OPTION, Parser
from core.errors import ProjectError
from core.said import say
from ui.words.catalogue import LANGUAGES

FOLDERS = ("BLOCK", "FOLDER")
"""Arguments that a shell completes with folders alone."""


@dataclass(frozen=True, slots=True)
class Verb:
    """What `gruber` can be asked to do."""

    act: str
    """Where it is done: a module of `app.verbs` and its function, for `pkgutil.resolve_name`."""
    summary: str
    examples: dict[str, str]
    add: Callable[[Parser], None]
    """Adds its arguments."""


def add_new(verb: Parser) -> None:
    """Arguments of `new`."""
    verb.add_argument("folder", type=Path, metavar="FOLDER", help="folder of scans and reference")
    project = "make the block from another program's project"
    verb.add_option("--from FORMAT", project, dest="format", choices=formats(True), default="")
    verb.add_option("--project PATH", "file or folder of that project (FOLDER)", type=Path)
    verb.add_option("--crs CRS", "its CRS, where the project names none", default="")
    sizes = "a list of scans (scan, columns, rows) that have no pictures: stand-ins are made"
    verb.add_option("--without-pictures LIST", sizes, type=Path, dest="sizes")
    verb.add_switch("--read-margin", "say what is printed beside the pictures")
    accepted = "the same, and write into block.toml on what all scans agree"
    verb.add_switch("--accept-margin", accepted)
    add_operator(verb)


def add_run(verb: Parser) -> None:
    """Arguments of `run`."""
    add_block(verb)
    names = stage_names()
    told = ", ".join(names)
    anew = say("make this stage and all after it anew; one of {names}", names=told)
    verb.add_option("--from STAGE", anew, dest="first", choices=names)
    verb.add_option("--until STAGE", "stop after this stage", dest="last", choices=names)
    add_workers(verb)
    where = (
        "where it runs: here in threads, in a process of its own, or on a worker of a Dask cluster "
        "(%(default)s)"
    )
    add_executor(verb, where, earlier=("local",))


def add_batch(verb: Parser) -> None:
    """Arguments of `batch`."""
    verb.add_argument(
        "list", type=Path, metavar="LIST", nargs="+",
        help="a block or a folder of blocks, a pattern such as rolls/19*, a text file with one "
        "path a line, or a CSV table with columns block, priority, until",
    )  # fmt: skip
    add_workers(verb)
    where = (
        "one block after another in threads, blocks side by side in processes, or the workers of a "
        "Dask cluster (%(default)s)"
    )
    add_executor(verb, where)


def add_executor(verb: Parser, told: str, earlier: tuple[str, ...] = ()) -> None:
    """Where blocks run; words of earlier versions are understood and not told."""
    from app.batch import EXECUTORS

    verb.add_argument(
        "--executor", choices=(*EXECUTORS, *earlier), default=EXECUTORS[0], help=told,
        metavar=f"{{{','.join(EXECUTORS)}}}",
    )  # fmt: skip
    verb.add_argument(
        "--scheduler", default="", metavar="ADDRESS",
        help="address of the Dask scheduler (a cluster on this machine)",
    )  # fmt: skip


def add_review(verb: Parser) -> None:
    """Arguments of `review`."""
    add_block(verb)
    add_desk(verb)


def add_report(verb: Parser) -> None:
    """Arguments of `report`."""
    add_block(verb)
    earlier = "compare with an earlier state: the folder of a copy, or a report.json that was kept"
    verb.add_option("--against OTHER", earlier, type=Path)
    verb.set_defaults(workers=Settings().workers)


def add_export(verb: Parser) -> None:
    """Arguments of `export`."""
    add_block(verb)
    names = formats(reads=False)
    known = say("one of {names}", names=names)
    verb.add_option("--to FORMAT", known, dest="format", choices=names, required=True)
    verb.add_option("--out PATH", "file or folder to write (results/export/...)", type=Path)
    frames = "coordinates of the map, or of a plane that touches the Earth there (%(default)s)"
    verb.add_argument("--frame", choices=["map", "tangent"], default="map", help=frames)
    pictures = "write the scans laid upright, where the format cannot hold film"
    verb.add_switch("--pictures", pictures)
    add_workers(verb)


def add_import(verb: Parser) -> None:
    """Arguments of `import`."""
    add_block(verb)
    # Both belong to the option: argparse finds no second place behind one.
    what = say(
        "a file or folder of that program; FORMAT is one of {names}", names=imported_formats()
    )
    verb.add_argument(
        "--from", dest="source", nargs=2, required=True, metavar=("FORMAT", "PATH"), help=what
    )
    answered = (
        "how a list is to be read, such as columns=id,Y,X,Z, axes='-E -N' or sigma_xy=0.02 of "
        "points, columns=scan,,X,Y,Z of orientations, origin=middle or sigma=0.3 of measurements; "
        "again for each"
    )
    verb.add_option("--answer WHAT=VALUE", answered, action="append", default=[])
    add_operator(verb)


def stage_names() -> tuple[str, ...]:
    """Stages in their order, for `--from` and `--until`."""
    from app.run import STAGE_NAMES

    return STAGE_NAMES


def formats(reads: bool) -> tuple[str, ...]:
    """Formats of other programs that can be read, or written."""
    from app.exchange import format_names

    return format_names(reads=reads)


def imported_formats() -> tuple[str, ...]:
    """What `import --from` takes."""
    from app.bring_points import POINT_TABLE

    return tuple(dict.fromkeys((POINT_TABLE, *formats(reads=True))))


def add_check(verb: Parser) -> None:
    """Arguments of `check`."""
    verb.add_argument(
        "what", choices=["plan", "sheets", "rules", "neighbours"],
        metavar="plan|sheets|rules|neighbours",
        help="choose the places, draw a sample of the map sheets, print the rules in force as a "
        "file to edit, or compare what the blocks of a folder share",
    )  # fmt: skip
    add_block(verb)
    verb.add_argument(
        "--cells", type=grid_size, default=None, metavar="6x5",
        help="columns and rows of the grid, a place for each cell (enough for 30 places)",
    )  # fmt: skip
    verb.add_argument(
        "--seed", type=whole_number(0), default=None, metavar="N",
        help="decides between places that are shown equally well (1), draws the sheets (at random)",
    )  # fmt: skip
    verb.add_argument(
        "--points", type=Path, default=None, metavar="FILE",
        help="a list of surveyed points, as [control] points",
    )  # fmt: skip
    add_operator(verb)


def add_change(verb: Parser) -> None:
    """Arguments of `change`."""
    several = "blocks over one place, each with scans of a year of its own"
    verb.add_argument("blocks", type=Path, nargs="+", metavar="BLOCK", help=several)
    folder = "folder that is written (%(default)s)"
    verb.add_option("--out FOLDER", folder, type=Path, default=Path("gruber-change"))


def add_teach(verb: Parser) -> None:
    """Arguments of `teach`; `--block` is an earlier form, which is understood and not told."""
    where = (
        "a block with known truth: lessons show its places, the experiment is done on it "
        "(gruber-demo)"
    )
    verb.add_argument("block", type=Path, nargs="?", default=None, metavar="BLOCK", help=where)
    verb.add_option("--block FOLDER", argparse.SUPPRESS, type=Path, dest="earlier")
    verb.add_option("--lesson NAME", "the lesson to begin with", default="")
    verb.add_switch("--list", "name the lessons and end")
    verb.add_option("--own FILE", "a Python file with one more lesson", type=Path)
    verb.add_switch("--hide-truth", "students, who come by a link, cannot show the truth")
    from app.experiments import EXPERIMENTS

    repeated = say(
        "repeat an experiment of the thesis and end; one of {names}", names=tuple(EXPERIMENTS)
    )
    verb.add_option("--experiment NAME", repeated, choices=tuple(EXPERIMENTS), default="")
    add_address(verb)


def add_demo(verb: Parser) -> None:
    """Arguments of `demo`."""
    sides = "scans of about 1100, 3200 or 12 900 pixels a side (%(default)s)"
    verb.add_argument("--size", choices=["tiny", "small", "full"], default="small", help=sides)
    changed = "much has changed since 1938, little since 1984 (%(default)s)"
    verb.add_argument("--epoch", type=int, choices=[1938, 1984], default=1938, help=changed)
    relief = "highest minus lowest ground, metres (%(default)g)"
    verb.add_option("--relief M", relief, type=metres, default=60.0)
    verb.add_option("--seed N", "any number (%(default)s)", type=whole_number(0), default=1)
    place = "where the block is made (%(default)s)"
    verb.add_option("--out FOLDER", place, type=Path, default=Path("gruber-demo"))
    verb.add_switch("--headless", "end with the results instead of opening the desk")
    add_workers(verb)
    add_desk(verb)


def add_doctor(verb: Parser) -> None:
    """Arguments of `doctor`."""
    add_block(verb, default=None)


def add_completion(verb: Parser) -> None:
    """Arguments of `completion`."""
    shells = ("bash", "zsh", "fish")
    told = say("one of {names}", names=shells)
    verb.add_argument("shell", choices=shells, metavar="SHELL", help=told)


def add_block(verb: Parser, default: Path | None = Path()) -> None:
    """The block: a folder or its block.toml; the current folder when left out."""
    place = "the block's folder or its block.toml"
    verb.add_argument("block", type=Path, nargs="?", default=default, metavar="BLOCK", help=place)


def add_workers(verb: Parser) -> None:
    """How much runs side by side."""
    pieces = "pieces of a stage that run side by side (%(default)s)"
    verb.add_option("--workers N", pieces, type=whole_number(1), default=Settings().workers)


def add_desk(verb: Parser) -> None:
    """Where the desk is served, and who sits at it."""
    add_address(verb)
    add_operator(verb)


def add_address(verb: Parser) -> None:
    """Where a page is served."""
    settings = Settings()
    port = "port of the desk; 0 takes any that is free (%(default)s)"
    verb.add_option("--port P", port, type=whole_number(0, 65535), default=settings.port)
    host = "address the desk listens at (%(default)s: this machine only)"
    verb.add_option("--host H", host, default=settings.host)
    proxy = "address browsers open if the desk is behind a proxy, as https://desk.example.org"
    verb.add_option("--address URL", proxy, type=proxy_address, default="")
    verb.add_switch("--no-browser", "print the address only")


def add_operator(verb: Parser) -> None:
    """Who decides."""
    name = "name under which decisions are recorded (%(default)s)"
    verb.add_option("--operator NAME", name, default=Settings().operator, type=operator_name)


def add_language(parsed: Parser, default: str) -> None:
    """In which language it is told."""
    language = "language of messages and report (English), and of the desk (that of each browser)"
    parsed.add_argument(OPTION, choices=LANGUAGES, default=default, help=language)


def add_log(parsed: Parser, default: object) -> None:
    """How it is told."""
    parsed.add_switch(
        "--log-json", "tell everything as one JSON object a line, for machines", default
    )


def wrong_use(given: argparse.Namespace) -> str:
    """What is wrong with options that hang together; empty when nothing is."""
    source = getattr(given, "source", None)
    if source and source[0] not in imported_formats():
        wrong = "--from {name} is no format; it is one of {names}"
        return say(wrong, name=source[0], names=imported_formats())
    if answers := getattr(given, "answer", ()):
        from app.answers import check_answers
        from app.bring_points import POINT_TABLE, reading_of

        try:
            if source and source[0] != POINT_TABLE:
                check_answers(source[0], answers)
            else:
                reading_of(answers)
        except ProjectError as error:
            return error.told
    if lesson := getattr(given, "lesson", ""):
        from app.found_lessons import find_lessons

        lessons = tuple(find_lessons(given.own))
        if lesson not in lessons:
            wrong = "--lesson {name} is no lesson; it is one of {names}"
            return say(wrong, name=lesson, names=lessons)
    first, last = getattr(given, "first", None), getattr(given, "last", None)
    if first and last:
        names = stage_names()
        if names.index(last) < names.index(first):
            wrong = "--until {last} comes before --from {first}; the stages are {names}"
            # What is typed is told as it is typed, whatever the language.
            return say(wrong, last=f"`{last}`", first=f"`{first}`", names=", ".join(names))
    return ""


VERBS = {
    "new": Verb(
        "new:new",
        "look through a folder and write the block.toml of what it holds",
        {
            "gruber new kobyli-1938": "says what it lacks, too",
            "gruber new flight --from metashape --project cameras.xml": "of another program",
        },
        add_new,
    ),
    "run": Verb(
        "run:run",
        "run the automatic stages, resuming where the last run stopped",
        {
            "gruber run kobyli-1938": "every stage; what is fresh is kept",
            "gruber run kobyli-1938 --until georeference": "stop once the photos are placed",
            "gruber run kobyli-1938 --from ties": "make the tie points anew, and what follows",
        },
        add_run,
    ),
    "batch": Verb(
        "run:batch",
        "run many blocks; what fails in one stops no other, and the table batch.csv says why",
        {
            "gruber batch archive": "every block below a folder, one after another",
            "gruber batch blocks.csv --executor processes": "blocks side by side",
            "gruber batch list.txt --executor dask --scheduler tcp://host:8786": "on many machines",
        },
        add_batch,
    ),
    "review": Verb(
        "review:review",
        "open the review desk in the browser",
        {
            "gruber review kobyli-1938": "opens the desk in the browser",
            "gruber review kobyli-1938 --operator anna": "decisions are recorded under this name",
            "gruber review kobyli-1938 --language cs": "texts in Czech",
            "gruber review kobyli-1938 --no-browser": "prints the address only",
        },
        add_review,
    ),
    "report": Verb(
        "run:report",
        "write results/report.html and report.json; what is not fresh is computed first",
        {
            "gruber report kobyli-1938": "prints where it is",
            "gruber report kobyli-1938 --language cs": "in Czech",
            "gruber report kobyli-1938 --against signed/report.json": "what has changed since",
        },
        add_report,
    ),
    "export": Verb(
        "exchange:export",
        "write the block as it stands in the format of another program",
        {
            "gruber export kobyli-1938 --to micmac": "into results/export",
            "gruber export kobyli-1938 --to colmap --pictures": "the scans laid upright go along",
            "gruber export kobyli-1938 --to odm --out gcp_list.txt": "one file where you want it",
        },
        add_export,
    ),
    "import": Verb(
        "exchange:bring",
        "take over points, measurements, orientations and fiducials from another program",
        {
            "gruber import kobyli-1938 --from points list.csv": "surveyed points of any table",
            "gruber import kobyli-1938 --from odm gcp_list.txt": "points and their measurements",
            "gruber import kobyli-1938 --from micmac project": "orientations and fiducials, too",
        },
        add_import,
    ),
    "check": Verb(
        "check:check",
        "plan places at which the mosaic is to be checked, draw a sample of its sheets, print its "
        "rules, compare neighbours",
        {
            "gruber check plan kobyli-1938": "before its first run, when no result is known",
            "gruber check plan kobyli-1938 --cells 8x5 --seed 7": "another grid, other places",
            "gruber check plan kobyli-1938 --points survey.csv": "surveyed points instead",
            "gruber check sheets kobyli-1938": "a sample by which all map sheets are accepted",
            "gruber check rules kobyli-1938": "every limit, as a file for [block] rules",
            "gruber check neighbours archive": "photos, points and ground that blocks share",
        },
        add_check,
    ),
    "change": Verb(
        "change:change",
        "compare blocks of several years: what was raised or lowered, where the picture differs",
        {
            "gruber change 1938 1953 1984": "each year with the one before",
            "gruber change 1938 1953 --out since-the-war": "another folder",
        },
        add_change,
    ),
    "teach": Verb(
        "teach:teach",
        "open lessons of photogrammetry whose formulas can be moved",
        {
            "gruber teach": "opens the lessons in the browser",
            "gruber teach --lesson relief": "begins with one of them",
            "gruber teach --list": "names them all",
            "gruber teach --own tower.py": "a teacher's own lesson among them",
            "gruber teach --experiment table-4": "a table of the thesis on the block of the demo",
        },
        add_teach,
    ),
    "demo": Verb(
        "demo:demo",
        "make a synthetic block with known truth, run it and open the desk",
        {
            "gruber demo": "six scans of 1938, run, compared with their truth, opened",
            "gruber demo --size tiny --headless": "the quickest look, without a browser",
            "gruber demo --epoch 1984 --seed 7 --out other": "another place, flight and film",
        },
        add_demo,
    ),
    "doctor": Verb(
        "doctor:doctor",
        "say what this machine and a block lack; lines with ! need attention",
        {
            "gruber doctor": "GDAL drivers, PROJ grids, browser, memory",
            "gruber doctor kobyli-1938": "its files and the disk as well",
        },
        add_doctor,
    ),
    "completion": Verb(
        "completion:completion",
        "print what lets a shell complete verbs, options and folders",
        {
            "gruber completion bash": "in ~/.bashrc: source <(gruber completion bash)",
            "gruber completion zsh": 'in ~/.zshrc, after compinit: eval "$(gruber completion zsh)"',
            "gruber completion fish": "in config.fish: gruber completion fish | source",
        },
        add_completion,
    ),
}
"""What it can be asked to do, in the order of its help."""
