"""The verbs: arguments in, exit code out.

What a verb does is imported once it is asked for: `gruber --help` waits for no engine and no desk.
"""

import argparse
import os
import signal
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pkgutil import resolve_name

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# What GDAL, OpenCV and PROJ say of a damaged file stands in our error; more would only be noise.
os.environ.setdefault("CPL_LOG", os.devnull)
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
os.environ.setdefault("PROJ_DEBUG", "0")

from app import verbs
from app.arguments import VERBS, add_language, add_log, wrong_use
from app.heap import share_heaps
from app.terminal import JsonLines, Terminal, Voice
from app.usage import Parser, Verbs, asked_language, asked_verb, teller_of_usage
from core.errors import Cancelled, PhotogrammetryError
from sessions.processes import end_with_starter
from ui.words.catalogue import LANGUAGES

DONE, UNUSABLE, CANCELLED = 0, 1, 130
CANCELS = {
    **dict.fromkeys(("run", "batch", "report", "export", "demo"), "terminal.cancelled.stages"),
    "review": "terminal.cancelled.review",
}
"""What Ctrl-C leaves of a verb, and how it goes on."""
DESCRIPTION = """\
Review app for archival aerial photogrammetry: from scans of film to a mosaic,
with every doubtful point laid before a human.
"""
ENDING = """\
A block is a folder with a block.toml; left out, it is the current folder.
`gruber VERB --help` says more, with examples.

Exit codes: 0 done; 1 the data cannot be used; 2 wrong use; 130 cancelled.
"""


def program() -> None:
    """The program `gruber`: a verb, then out.

    After Ctrl-C it does not wait for threads that still compute: nothing they do is kept. What asks
    it to end is as Ctrl-C, so that what it has started ends with it.
    """
    signal.signal(signal.SIGTERM, end_as_ctrl_c)
    share_heaps()
    end_with_starter()
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    if code == CANCELLED:
        os._exit(code)
    sys.exit(code)


def end_as_ctrl_c(*_: object) -> None:
    """End as Ctrl-C does, also where a shell keeps that from what runs in the background."""
    if not callable(signal.getsignal(signal.SIGINT)):
        raise KeyboardInterrupt
    signal.raise_signal(signal.SIGINT)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a verb; 0 done, 1 the data cannot be used, 2 wrong use, 130 cancelled."""
    arguments = sys.argv[1:] if arguments is None else arguments
    top = parser(asked_language(arguments), asked_verb(arguments, VERBS))
    given = top.parse_args(arguments)
    voice: Voice = (
        JsonLines() if given.log_json else Terminal(language=given.language or LANGUAGES[0])
    )
    act: Callable[[argparse.Namespace, Voice], None] = resolve_name(
        f"{verbs.__name__}.{VERBS[given.verb].act}"
    )
    try:
        with named_files():
            if wrong := wrong_use(given):
                top.error(top.tell.again(wrong))
            act(given, voice)
    except PhotogrammetryError as error:
        voice.failed(error)
        print(f"gruber: {voice.tell.again(error.told)}", file=sys.stderr)
        return UNUSABLE
    except (KeyboardInterrupt, Cancelled):
        voice.close()
        kept = CANCELS.get(given.verb, "terminal.cancelled")
        print(f"gruber: {voice.tell(kept)}", file=sys.stderr)
        return CANCELLED
    finally:
        voice.close()
    return DONE


@contextmanager
def named_files() -> Generator[None]:
    """A file or folder that may not be used, and that nobody asked for before, is told as others.

    Raises:
        PhotogrammetryError: The system refused it.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None:
            raise
        raise PhotogrammetryError(
            os.fsdecode(error.filename),
            "cannot be used ({error}).",
            "Check that it is there, and that you may read and write it.",
            error=error.strerror,
        ) from error


def parser(language: str = LANGUAGES[0], asked: str | None = None) -> Parser:
    """All verbs, told in a language.

    Args:
        language: The language of the help.
        asked: The verb whose arguments are needed, empty for none; None adds those of all.
    """
    tell = teller_of_usage(language)
    again = tell.again
    top = Parser(tell, prog="gruber", description=again(DESCRIPTION), epilog=again(ENDING))
    told = "show the version and exit"
    top.add_argument(
        "--version", action="version", version=f"gruber {version('gruber')}", help=told
    )
    add_log(top, default=False)
    add_language(top, default="")
    added = Verbs(tell, top.add_subparsers(title=again("verbs"), required=True, metavar="VERB"))
    for name, known in VERBS.items():
        verb = added.add(name, known.summary, known.examples)
        # Understood before the verb and after it; left out here, what stood before it holds.
        add_log(verb, default=argparse.SUPPRESS)
        add_language(verb, default=argparse.SUPPRESS)
        verb.set_defaults(verb=name)
        if asked in (None, name):
            known.add(verb)
    return top
