"""Settings of a start."""

import getpass
from threading import Event

import pytest

from app.settings import Settings, Threads, default_operator
from core.errors import Cancelled


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


def test_threads_give_results_in_the_order_of_the_items__law() -> None:
    threads, slow = Threads(3), Event()

    def half(item: int) -> float:
        # The first waits for the last, and still comes out first.
        if item == 0:
            slow.wait(5)
        if item == 2:
            slow.set()
        return item / 2

    assert list(threads.map(half, range(3))) == [0, 0.5, 1]
    with pytest.raises(ZeroDivisionError):
        list(threads.map(lambda item: 1 / item, [1, 0, 2]))
    threads.close()


def test_work_that_is_no_longer_wanted_is_not_waited_for__law() -> None:
    asked, over = Event(), Event()

    def check() -> None:
        if asked.is_set():
            raise Cancelled

    def endless(_: int) -> None:
        asked.set()
        over.wait(10)

    threads = Threads(1, check)
    with pytest.raises(Cancelled):
        list(threads.map(endless, range(2)))
    assert not over.is_set()
    over.set()
    threads.close()
