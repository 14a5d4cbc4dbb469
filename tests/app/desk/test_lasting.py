"""The desk's secret outlives the program."""

from pathlib import Path

from app.desk.lasting import lasting_token


def test_the_secret_is_its_owner_s_and_stays__law(tmp_path: Path) -> None:
    first = lasting_token(tmp_path)
    assert len(first) >= 32
    assert lasting_token(tmp_path) == first
    assert (tmp_path / "desk-token").stat().st_mode & 0o077 == 0
