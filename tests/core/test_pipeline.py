"""The table of contents of the engine."""

from core.pipeline import STAGES
from core.results import BlockInput


def test_every_stage_needs_only_what_comes_before_it__law():
    before: set[str] = set()
    for stage in STAGES:
        assert set(stage.needs) <= before
        before.add(stage.name)
    assert len(before) == len(STAGES)


def test_every_part_of_a_description_enters_a_stage__law(given):
    """A changed reference, scan or setting must not leave a stale product."""
    entered = [part for stage in STAGES for part in stage.inputs(given)]
    # The last adjustment, which decisions enter as well, is a stage of `app.run`.
    for name in BlockInput.__dataclass_fields__:
        if name not in ("name", "adjustment"):
            value = getattr(given, name)
            assert any(part is value for part in entered), name
