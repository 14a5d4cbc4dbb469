"""Settings of a start."""

import getpass

import pytest

from app.settings import Settings, default_operator


def test_operator_is_the_user_and_the_desk_stays_on_this_machine__truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("USER", "ada")
    settings = Settings()
    assert (settings.operator, settings.host) == ("ada", "127.0.0.1")
    assert settings.workers >= 1


def test_a_user_without_a_name_is_the_operator__truth(monkeypatch: pytest.MonkeyPatch) -> None:
    def nameless() -> str:
        raise KeyError("getpwuid(): uid not found: 12345")

    monkeypatch.delenv("USER", raising=False)
    monkeypatch.setattr(getpass, "getuser", nameless)
    assert default_operator() == "operator"
