"""Long work at the desk: one at a time, seen, and stopped when asked."""

import pytest

from app.desk.watched_job import WatchedJob
from core.errors import Cancelled, ProjectError

BUSY = ProjectError("block.toml", "is at work.", "Wait for it.")


def test_one_is_at_work_and_tells_how_far_it_is__truth() -> None:
    job = WatchedJob(BUSY)
    assert job.status() == {"busy": False, "share": 0.0, "what": ""}
    with job.begun():
        job.report(1, 4, "sheet")
        assert job.status() == {"busy": True, "share": 0.25, "what": "sheet"}
        with pytest.raises(ProjectError, match="is at work"), job.begun():
            pass
        assert job.status()["busy"]
    assert not job.status()["busy"]


def test_it_stops_when_asked_and_the_next_one_goes_on__law() -> None:
    job = WatchedJob(BUSY)
    job.cancel()
    with job.begun():
        job.cancel()
        with pytest.raises(Cancelled):
            job.report(1, 4)
    with job.begun():
        job.report(1, 4)
