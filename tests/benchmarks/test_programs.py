"""Programs of the benchmarks begin: what they import is there, and the desk's block is built."""

from importlib import import_module
from pathlib import Path

import pytest

from app.desk.inputs import first_snapshot
from tests.benchmarks.desk_film import with_film
from tests.benchmarks.large_desk import Size, large_inputs, with_huge_scan

PROGRAMS = sorted(
    path.stem for path in Path(__file__).parent.glob("*.py") if not path.stem.startswith("test_")
)


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_finds_all_that_it_imports__law(name):
    import_module(f"tests.benchmarks.{name}")


@pytest.mark.filterwarnings("ignore")
def test_the_desk_that_is_measured_is_built__law(tmp_path):
    size = Size(strips=1, photos_a_strip=2, proposals=40, ties=100, scan_px=200)
    inputs = with_film(with_huge_scan(large_inputs(tmp_path, size), 400), tmp_path)
    with inputs.session:
        desk = first_snapshot(inputs)
        assert len(desk.base.measurements) == size.proposals
        assert inputs.evidence(inputs.report).gains
