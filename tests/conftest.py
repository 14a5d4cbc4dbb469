"""What all tests share: real data beside the checkout, one BLAS thread, one tiny block."""

import gc
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from fcntl import LOCK_EX, flock
from pathlib import Path

import jaxtyping
import pytest
from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# It lays itself around the functions of what is imported after it.
from tests import shapes

# isort: split
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from tests.tiny import Tiny, open_tiny, with_check_points

REPOSITORY = Path(__file__).resolve().parents[1]
LONG = {"real", "journeys", "test_every_page", "test_start"}
CORE = REPOSITORY / "tests" / "core"

# Tests judge results; how long one takes depends on what else the machine does.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files of minutes first, so that no worker waits at the end for the other's last one."""
    for item in items:
        if CORE in item.path.parents and not item.get_closest_marker("slow"):
            item.add_marker("shapes")
    long = {item.path for item in items if item.get_closest_marker("slow")}
    long |= {item.path for item in items if LONG & {item.path.parent.name, item.path.stem}}
    items.sort(key=lambda item: item.path not in long)


def pytest_collection_finish() -> None:
    """Modules and tests stay to the end: the garbage collector need not look through them again.

    Nor need it look after every 700 values: syntax trees and reports are made of millions.
    """
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Shapes are checked by the tests of the engine, but by its long ones.

    Elsewhere checks would take a third of the time, and find what these find: `make test` does not
    even load them there.
    """
    shapes.begin(checked=item.get_closest_marker("shapes") is not None)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Iterator[None]:
    """What many tests share is made without checks."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", before or fixturedef.scope != "function")
    try:
        return (yield)
    finally:
        jaxtyping.config.update("jaxtyping_disable", before)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real blocks; skipped plainly where it is not there."""
    folder = Path(os.environ.get("GRUBER_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real data not found at {folder}; set GRUBER_DATA")
    return folder


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that one of the workers makes and all may read.

    `make test` runs pytest three times: GRUBER_MADE names what both may use.
    """
    base = factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    shared = Path(os.environ.get("GRUBER_MADE", shared))
    folder, done = shared / name, shared / f"{name}.done"
    with (shared / f"{name}.lock").open("w") as lock:
        flock(lock, LOCK_EX)
        if not done.exists():
            shutil.rmtree(folder, ignore_errors=True)
            make(folder)
            done.touch()
    return folder


@pytest.fixture(scope="session")
def teaching_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The teaching flight, not in the cache of who runs the tests."""
    from app.lessons import places

    with pytest.MonkeyPatch.context() as patch:

        def make(folder: Path) -> None:
            patch.setattr(places, "cache_folder", lambda: folder)
            places.teaching_flight()

        folder = made_once(tmp_path_factory, "teaching", make)
        patch.setattr(places, "cache_folder", lambda: folder)
        yield folder


@pytest.fixture(scope="session")
def tiny_block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic block of six small scans, never written to."""
    options = SyntheticOptions("tiny")
    return made_once(tmp_path_factory, "tiny", lambda folder: make_block(folder, options))


@pytest.fixture(scope="session")
def tiny(tiny_block: Path) -> Tiny:
    """The tiny block at its true orientations."""
    return open_tiny(tiny_block)


@pytest.fixture(scope="session")
def tiny_run(tiny_block: Path, tmp_path_factory: pytest.TempPathFactory) -> Tiny:
    """A copy of the tiny block with check points that was run; whoever changes it puts it back."""

    def run(folder: Path) -> None:
        shutil.copytree(tiny_block, folder)
        with_check_points(open_tiny(folder))
        # In a process of its own: checking shapes at every call takes a third of the time.
        subprocess.run(
            [sys.executable, "-m", "gruber", "run", str(folder)], cwd=REPOSITORY, check=True
        )

    ready = made_once(tmp_path_factory, "tiny-run", run)
    folder = tmp_path_factory.mktemp("run") / "block"
    shutil.copytree(ready, folder)
    return open_tiny(folder)
