"""Copies of a block to be spoilt, and the command line run on them."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli import main
from core.pipeline import STAGES
from core.synthetic.truth import Truth
from sessions.session import Session
from tests.forked import Forked, Told

REPOSITORY = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class BlockCopy:
    """A block whose files may be replaced; they are links to those of the original."""

    folder: Path

    @property
    def scans(self) -> list[Path]:
        return sorted((self.folder / "scans").glob("*.tif"))

    @property
    def results(self) -> Path:
        return self.folder / "results"

    def setting(self, key: str, value: str) -> None:
        """Set a key of block.toml that is there."""
        path = self.folder / "block.toml"
        text, count = re.subn(
            rf"^{key} = .*$", lambda _: f"{key} = {value}", path.read_text(), flags=re.MULTILINE
        )
        assert count == 1, key
        self.replace("block.toml", text)

    def replace(self, name: str | Path, content: str | bytes) -> Path:
        """Put another file in the place of one; the original keeps its content."""
        path = self.folder / name
        path.unlink(missing_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    def own(self, name: str | Path) -> Path:
        """A file that may be written to without changing the original."""
        path = self.folder / name
        return self.replace(path, path.read_bytes())

    def report(self) -> dict[str, Any]:
        return json.loads((self.results / "report.json").read_text(encoding="utf-8"))


def copied(block: Path, folder: Path, scans: int) -> BlockCopy:
    """A copy made of links, with the first so many scans."""
    left_out = {path.stem for path in sorted((block / "scans").glob("*.tif"))[scans:]}
    made = {"truth", "results", ".gruber", "session.gpkg"}

    def passed_over(_: str, names: list[str]) -> set[str]:
        return {name for name in names if Path(name).stem in left_out or name in made}

    shutil.copytree(block, folder, copy_function=os.link, ignore=passed_over)
    return BlockCopy(folder)


def nearly_placed(copy: BlockCopy, truth: Truth) -> None:
    """Say where the photos were taken, to some metres: finding them else takes a third of a run."""
    rows = ["scan,X,Y,Z,omega_deg,phi_deg,kappa_deg,sigma_X,sigma_Y,sigma_Z"]
    for scan in copy.scans:
        true = truth.photos[scan.stem].exterior
        angles = np.degrees([true.omega, true.phi, true.kappa])
        told = [*np.round(true.centre, -1), *np.round(angles), 20, 20, 20]
        rows.append(",".join([scan.stem, *(f"{value:.0f}" for value in told)]))
    copy.replace("eo.csv", "\n".join(rows))
    text = (copy.folder / "block.toml").read_text()
    copy.replace("block.toml", text.replace("[scans]\n", '[scans]\nexterior = "eo.csv"\n'))


def gruber(capsys: pytest.CaptureFixture[str], *arguments: object) -> Told:
    """The command line in this process."""
    capsys.readouterr()
    try:
        code = main([str(argument) for argument in arguments])
    except SystemExit as ended:
        code = int(ended.code or 0)
    told = capsys.readouterr()
    return Told(code, told.out, told.err)


def run_alone(*arguments: object) -> Told:
    """The command line in a process of its own, where shapes are not checked at every call."""
    with Forked(main, [str(argument) for argument in arguments]) as process:
        return process.ended()


def started(*arguments: object, **given: Any) -> subprocess.Popen[str]:
    """The command line as a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "gruber", *map(str, arguments)],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        **given,
    )


@contextmanager
def reviewing(folder: Path) -> Generator[str]:
    """`gruber review` on a folder: its address."""
    # A shell lets what it starts in the background ignore Ctrl-C, and children with it.
    allow = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    program = started(
        "review", folder, "--port", "0", "--no-browser", "--log-json", preexec_fn=allow, bufsize=1
    )
    assert program.stdout is not None
    try:
        said = json.loads(program.stdout.readline())["text"]
        yield next(word for word in said.split() if word.startswith("http://"))
    finally:
        program.send_signal(signal.SIGINT)
        program.communicate(timeout=60)


def stages_walked(folder: Path) -> int:
    """How often a stage of the engine was made or found fresh: the repeated ones in each pass."""
    with Session.open(folder, "reader") as session:
        passes = session.products.latest_value("control").passes
    return sum(passes if stage.repeated else 1 for stage in STAGES)
