"""Spoilt inputs for every reader: a named error or a sensible result, and nothing else.

`python -m tests.journeys.fuzz --cases 10000 --seed 1` runs that many cases and prints each that
went wrong; `--only N` repeats the case of one number with all it said. Every case is a process of
its own, with a limit of time and memory, over a fresh copy of a good sample of which one thing is
bad. Names, places in the folder and contents are spoilt by `tests/journeys/hostile.py`.
"""

import argparse
import ctypes
import dataclasses
import faulthandler
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from unicodedata import category

import numpy as np

import app.cli  # noqa: F401 (first: it says what libraries may print)
from core.errors import PhotogrammetryError
from core.formats.exchange import ExchangeBlock
from core.said import HIDDEN
from tests.journeys import hostile
from tests.journeys.fuzz_targets import Target

MEMORY = 1 << 30
"""Bytes a case may take beyond what the process takes before."""
LONGEST_MESSAGE = 2000
LINKED_BYTES = 20_000
CAPABILITIES = 0x20080522
"""Version 3 of what capset(2) takes."""
GOOD, NAMED = "good", "named"
"""Outcomes that are as promised."""


@dataclasses.dataclass(frozen=True)
class Case:
    """What a number stands for."""

    seed: int
    number: int
    target: str
    spoilt: str
    outcome: str
    """`good`, `named`, or what went wrong."""
    told: str
    seconds: float

    @property
    def wrong(self) -> bool:
        return self.outcome not in (GOOD, NAMED)

    def __str__(self) -> str:
        head = f"{self.seed}:{self.number} {self.target} [{self.spoilt}] {self.seconds:.1f} s"
        return f"{head}: {self.outcome}\n    {self.told.strip()[-3000:]}"


def run_case(targets: Sequence[Target], folder: Path, seed: int, number: int) -> Case:
    """One case, in a folder of its own that is removed behind it."""
    rng = np.random.default_rng([seed, number])
    weights = np.array([one.weight for one in targets], dtype=float)
    target = targets[int(rng.choice(len(targets), p=weights / weights.sum()))]
    room = folder / f"case-{number}"
    room.mkdir()
    (room / "beside.txt").write_text("1 0 0 -1 0 0\n")
    home = room / "home"
    shutil.copytree(target.sample, home, copy_function=_copied)
    spoilt, subject = _spoil(rng, target, home, room / "beside.txt", folder)
    before = _state(room)
    began = time.monotonic()
    outcome, told = _in_a_child(target, subject, room)
    seconds = time.monotonic() - began
    if outcome in (GOOD, NAMED):
        damage = _touched(before, _state(room), target, outcome)
        outcome, told = ("wrote", damage) if damage else (outcome, told)
    _remove(room)
    return Case(seed, number, target.name, spoilt, outcome, told, seconds)


@cache
def _others(samples: Path) -> list[Path]:
    """Every file of every sample."""
    return hostile.files_in(samples)


def _copied(source: str, target: str) -> None:
    """A file of its own, or a link to one that is too large to copy for each case."""
    if os.path.getsize(source) > LINKED_BYTES:
        os.link(source, target)
    else:
        shutil.copy2(source, target)


def _spoil(
    rng: np.random.Generator, target: Target, home: Path, outside: Path, pool: Path
) -> tuple[str, Path]:
    """Spoil one thing of a sample; what was done, and what is read now."""
    subject = home / target.reads
    first = home / target.first if target.first else None
    files = hostile.files_in(home)
    chosen = files[int(rng.integers(len(files)))]
    if first is not None and rng.random() < target.first_share:
        chosen = first
    which = rng.random()
    if which < 0.08:
        folders = [chosen, *(one for one in chosen.parents if home in one.parents)]
        place = folders[int(rng.integers(len(folders)))]
        said = hostile.spoil_place(rng, place, outside)
        return f"{place.relative_to(home)}: {said}", subject
    if which < 0.13:
        named = hostile.odd_name(rng, chosen)
        if chosen == subject:
            subject = named
        return f"{chosen.relative_to(home)}: named {named.name!r}", subject
    said: list[str] = []
    for _ in range(1 if rng.random() < 0.8 else 2):
        said.append(hostile.spoil_content(rng, chosen, _others(pool / "samples")))
    return f"{chosen.relative_to(home)}: {', '.join(said)}", subject


def _in_a_child(target: Target, subject: Path, room: Path) -> tuple[str, str]:
    """Read in a forked process; how it ended and what it said."""
    said = room.with_suffix(".said")
    child = os.fork()
    if child == 0:
        _live_and_die(target, subject, room, said)
    _, status = os.waitpid(child, 0)
    text = said.read_text(errors="replace")
    said.unlink()
    if os.WIFSIGNALED(status):
        return f"killed by {signal.Signals(os.WTERMSIG(status)).name}", text
    head, _, rest = text.rpartition("\n@@")
    if not rest:
        return ("hang" if "Timeout" in text else "gone"), text
    outcome, _, told = rest.partition("\n")
    if outcome in (GOOD, NAMED) and head.strip():
        return "noise", head
    return outcome, head + told


def _live_and_die(target: Target, subject: Path, room: Path, said: Path) -> None:
    """The child: reads, says how it went, and is gone without any clearing up."""
    with said.open("w", errors="backslashreplace") as out:
        os.dup2(out.fileno(), 1)
        os.dup2(out.fileno(), 2)
        sys.stdout = sys.stderr = out
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        _obey_rights()
        resource.setrlimit(resource.RLIMIT_AS, (taken + MEMORY, taken + MEMORY))
        faulthandler.dump_traceback_later(target.seconds, exit=True, file=out.fileno())
        os.chdir(room)
        outcome, told = judged(target, subject)
        out.write(f"\n@@{outcome}\n{told}")
        out.flush()
        os._exit(0)


def _obey_rights() -> None:
    """Let the rights of files hold for root as well: what root may do beyond them is given up."""
    head = (ctypes.c_uint32 * 2)(CAPABILITIES, 0)
    assert ctypes.CDLL(None).capset(head, (ctypes.c_uint32 * 6)()) == 0


def judged(target: Target, subject: Path) -> tuple[str, str]:
    """How reading ends: as promised, or what was wrong."""
    try:
        with ExitStack() as stack:
            if not target.shows_warnings:
                stack.enter_context(warnings.catch_warnings())
                warnings.simplefilter("error")
            made = target.read(subject)
    except PhotogrammetryError as error:
        return _named(str(error), error.file, error.cause, error.remedy)
    except BaseException as error:  # noqa: BLE001
        return type(error).__name__, traceback.format_exc()
    if isinstance(made, ExchangeBlock) and (bad := _not_finite(made)):
        return "not finite", bad
    return GOOD, ""


def _named(told: str, file: str, cause: str, remedy: str) -> tuple[str, str]:
    """An error of ours: one line, with file, cause and remedy."""
    if any(category(sign) in HIDDEN for sign in told):
        return "several lines", told
    if len(told) > LONGEST_MESSAGE:
        return "long message", told[:200]
    if not (file.strip() and str(cause).strip() and str(remedy).strip()):
        return "nothing named", told
    return NAMED, told


def _not_finite(block: ExchangeBlock) -> str:
    """Numbers of a block that are none."""
    for photo in block.photos.values():
        if (
            photo.exterior is not None
            and not np.isfinite([*photo.exterior.centre, *photo.exterior.angles]).all()
        ):
            return f"photo {photo.photo_id}: {photo.exterior}"
        if photo.pixel_from_image is not None and not np.isfinite(photo.pixel_from_image).all():
            return f"photo {photo.photo_id}: {photo.pixel_from_image}"
    for point in block.points.values():
        if not np.isfinite([*point.position, *(point.sigma_m or ())]).all():
            return str(point)
    for one in block.measurements:
        if not np.isfinite([one.column, one.row, one.sigma_px or 0]).all():
            return str(one)
    return "" if np.isfinite(block.ties.pixels).all() else "ties"


State = dict[str, str]


def _state(room: Path) -> State:
    """Every path below a folder with what it is: files by inode, size and time."""
    found: State = {}
    for root, folders, files in os.walk(room):
        for name in (*folders, *files):
            path = Path(root, name)
            if path.is_symlink():
                what = f"link {os.readlink(path)}"
            elif path.is_file():
                status = path.stat()
                what = f"{status.st_ino} {status.st_size} {status.st_mtime_ns}"
            else:
                what = "folder" if path.is_dir() else "other"
            found[str(path.relative_to(room))] = what
    return found


def _touched(before: State, after: State, target: Target, outcome: str) -> str:
    """What was written though it should not have been; empty where nothing was."""
    changed = [path for path in {**before, **after} if before.get(path) != after.get(path)]
    allowed = target.may_write if outcome == GOOD else target.may_leave
    wrong = [
        path for path in changed if not path.startswith(tuple(f"home/{one}" for one in allowed))
    ]
    halves = [path for path in after if ".part-" in path or path.endswith("-journal")]
    return ", ".join(sorted(wrong + halves)[:6])


def _remove(room: Path) -> None:
    for path in (room, *room.rglob("*")):
        if not path.is_symlink():
            path.chmod(0o700)
    shutil.rmtree(room)


def run_cases(
    targets: Sequence[Target], folder: Path, seed: int, numbers: Sequence[int]
) -> Iterator[Case]:
    """Cases one after another; samples lie in `samples` of the folder."""
    for number in numbers:
        yield run_case(targets, folder, seed, number)


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> int:
    """The long run."""
    from tests.journeys.fuzz_targets import all_targets

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="repeat one case")
    parser.add_argument("--target", default="", help="only targets whose name has this")
    given = parser.parse_args()
    data = os.environ.get("GRUBER_DATA")
    real = None if data is None else Path(data)
    began, counts, slowest = time.monotonic(), Counter[str](), 0.0
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    folder.chmod(0o755)
    try:
        targets = [
            one for one in all_targets(folder / "samples", real=real) if given.target in one.name
        ]
        numbers = range(given.first, given.first + given.cases)
        for case in run_cases(
            targets, folder, given.seed, numbers if given.only is None else [given.only]
        ):
            counts["wrong" if case.wrong else case.outcome] += 1
            counts[f"  {case.target}"] += 1
            slowest = max(slowest, case.seconds)
            if case.wrong or given.only is not None:
                say(str(case))
    finally:
        shutil.rmtree(folder)
    say(json.dumps(counts, indent=1))
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    say(f"{time.monotonic() - began:.0f} s, slowest {slowest:.1f} s, most memory {most:.0f} MiB")
    return int(counts["wrong"] > 0)


if __name__ == "__main__":
    sys.exit(main())
