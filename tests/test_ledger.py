"""Every number of core has a reason beside it."""

import re

from tests.ledger import EXEMPT, HOME, all_settings, settings_in


def test_every_number_of_core_has_a_reason__law() -> None:
    bare = [s for s in all_settings() if not s.kind and s.room not in EXEMPT]
    assert not [f"{s.file}:{s.line} {s.name} = {s.value}" for s in bare]


def test_a_measured_number_names_a_script_that_exists__law() -> None:
    scripts = {path.stem for path in (HOME / "tests").rglob("*.py")}
    measured = [s for s in all_settings() if s.kind == "measured"]
    unknown = [s for s in measured if not scripts & set(re.findall(r"\w+", s.reason))]
    assert not [f"{s.file}:{s.line} {s.name}: {s.reason}" for s in unknown]


def test_the_ledger_finds_settings_and_their_reasons__truth() -> None:
    text = '''
"""A module."""
# source: Huber 1981
# page 43
BEND = 1.345
"""Where it bends."""
WEIGHTS = (0.3, 7)  # design: comfort
NONE = np.zeros(17)
STAGE_VERSION = 8

class SearchOptions:
    # The words before do no harm.
    # measured: bench_search, half and double
    reach: int = 3
    other: float = 8.0

class Value:
    plain: int = 3
    odd: int = 33

def area(points, share=0.7):
    """Docstring with 77."""
    # design: not so few
    if len(points) < 55:
        return points[99] ** 6 + 0.5 * 255
    return round(sum(points, axis=5) / -12.5, 5) + f"{points:77.7f}"
'''
    found = [(s.name, s.value, s.kind, s.reason) for s in settings_in(text, "core/a/b.py")]
    assert found == [
        ("BEND", "1.345", "source", "Huber 1981 page 43"),
        ("WEIGHTS", "(0.3, 7)", "design", "comfort"),
        ("SearchOptions.reach", "3", "measured", "bench_search, half and double"),
        ("SearchOptions.other", "8.0", "", ""),
        ("Value.odd", "33", "", ""),
        ("area", "0.7", "", ""),
        ("area", "55", "design", "not so few"),
        ("area", "-12.5", "", ""),
    ]
