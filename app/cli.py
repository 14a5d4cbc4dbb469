"""The verbs: arguments in, exit code out."""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from app import verbs
from app.settings import default_operator
from app.terminal import JsonLines, Terminal, Voice
from core.errors import Cancelled, PhotogrammetryError

Verbs = Any
"""What `add_subparsers` returns; argparse keeps the name of its type to itself."""
DONE, UNUSABLE, CANCELLED = 0, 1, 130


def program() -> None:
    """The program `gruber`: a verb, then out.

    After Ctrl-C it does not wait for threads that still compute: nothing they do is kept.
    """
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    if code == CANCELLED:
        os._exit(code)
    sys.exit(code)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a verb; 0 done, 1 the data cannot be used, 2 wrong use, 130 cancelled."""
    top = parser()
    given = top.parse_args(arguments)
    if wrong := wrong_order(given):
        top.error(wrong)
    voice: Voice = JsonLines() if given.log_json else Terminal()
    verb: Callable[[argparse.Namespace, Voice], None] = given.verb
    try:
        verb(given, voice)
    except PhotogrammetryError as error:
        voice.failed(error)
        print(f"gruber: {error}", file=sys.stderr)
        return UNUSABLE
    except (KeyboardInterrupt, Cancelled):
        voice.close()
        print("gruber: cancelled; the next start goes on from here.", file=sys.stderr)
        return CANCELLED
    finally:
        voice.close()
    return DONE


def parser() -> argparse.ArgumentParser:
    """All verbs with their arguments."""
    top = argparse.ArgumentParser(
        prog="gruber", description="Review app for archival aerial photogrammetry."
    )
    top.add_argument("--log-json", action="store_true", help="one JSON object a line")
    added = top.add_subparsers(title="verbs", required=True, metavar="VERB")
    for build in (add_new, add_run, add_review, add_report, add_demo, add_doctor):
        build(added)
    return top


def add_new(added: Verbs) -> None:
    """`new`."""
    verb = added.add_parser("new", help="look through a folder and write its block.toml")
    verb.add_argument("folder", type=Path)
    verb.set_defaults(verb=verbs.new)


def add_run(added: Verbs) -> None:
    """`run`."""
    verb = added.add_parser("run", help="the automatic stages, resuming where the last run stopped")
    add_block(verb)
    names = verbs.stage_names()
    verb.add_argument("--from", dest="first", choices=names, help="make this stage anew")
    verb.add_argument("--until", dest="last", choices=names, help="stop after this stage")
    verb.add_argument("--workers", type=whole_number(1), default=os.cpu_count() or 1)
    verb.add_argument("--executor", choices=["local"], default="local")
    verb.set_defaults(verb=verbs.run)


def add_review(added: Verbs) -> None:
    """`review`."""
    verb = added.add_parser("review", help="the review desk in the browser")
    add_block(verb)
    add_desk(verb)
    verb.set_defaults(verb=verbs.review)


def add_report(added: Verbs) -> None:
    """`report`."""
    verb = added.add_parser("report", help="results/report.html and report.json")
    add_block(verb)
    verb.set_defaults(verb=verbs.report)


def add_demo(added: Verbs) -> None:
    """`demo`."""
    verb = added.add_parser("demo", help="a synthetic block with known truth, run and opened")
    verb.add_argument("--size", choices=["tiny", "small", "full"], default="small")
    verb.add_argument("--epoch", type=int, choices=[1938, 1984], default=1938)
    verb.add_argument("--relief", type=float, default=60.0, metavar="M")
    verb.add_argument("--seed", type=whole_number(0), default=1)
    verb.add_argument("--out", type=Path, default=Path("gruber-demo"))
    verb.add_argument("--headless", action="store_true", help="print the results and end")
    add_desk(verb)
    verb.set_defaults(verb=verbs.demo, workers=os.cpu_count() or 1)


def add_doctor(added: Verbs) -> None:
    """`doctor`."""
    verb = added.add_parser("doctor", help="what this machine and this block lack")
    add_block(verb, default=None)
    verb.set_defaults(verb=verbs.doctor)


def add_block(verb: argparse.ArgumentParser, default: Path | None = Path()) -> None:
    """The block: a folder or its block.toml; the current folder when left out."""
    verb.add_argument("block", type=Path, nargs="?", default=default, metavar="BLOCK")


def add_desk(verb: argparse.ArgumentParser) -> None:
    """Where the desk is served, and who sits at it."""
    verb.add_argument("--port", type=whole_number(0, 65535), default=8765)
    verb.add_argument("--host", default="127.0.0.1")
    verb.add_argument("--operator", default=default_operator())
    verb.add_argument("--no-browser", action="store_true")


def wrong_order(given: argparse.Namespace) -> str:
    """What is wrong with `--from` and `--until`; empty when nothing is."""
    first, last = getattr(given, "first", None), getattr(given, "last", None)
    names = verbs.stage_names()
    if first and last and names.index(last) < names.index(first):
        return f"--until {last} comes before --from {first}; the stages are {', '.join(names)}"
    return ""


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """Reads a whole number within limits."""

    def number(text: str) -> int:
        if not text.lstrip("-").isdecimal():
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number")
        if int(text) < least or (most is not None and int(text) > most):
            limits = f"{least} or more" if most is None else f"from {least} to {most}"
            raise argparse.ArgumentTypeError(f"must be {limits}, not {text}")
        return int(text)

    return number


if __name__ == "__main__":
    program()
