"""A block run with check points and without them: the same orientations to the last digit."""

from core.adjustment.adjusted import AdjustmentReport
from sessions.session import Session
from tests.core.control.test_check_points import assert_same
from tests.journeys.copies import run_alone


def product(folder, stage):
    with Session.open(folder, "reader") as session:
        return session.products.latest_value(stage)


def test_no_stage_knows_of_check_points__law(tiny_run, copy_of):
    """The block of `tiny_run` has six, each measured by hand; this one has neither."""
    plain = copy_of()
    assert run_alone("run", plain.folder, "--until", "adjustment").code == 0
    for stage in ("localisation", "control", "adjustment"):
        one, other = product(plain.folder, stage), product(tiny_run.folder, stage)
        if stage == "adjustment":
            assert isinstance(other, AdjustmentReport)
            assert len(other.checks) == 6
            assert not one.checks
            assert one.sigma_nought == other.sigma_nought
            assert one.rejected == other.rejected
        blocks = [getattr(value, "report", value) for value in (one, other)]
        assert_same(*(getattr(value, "block", value) for value in blocks))
