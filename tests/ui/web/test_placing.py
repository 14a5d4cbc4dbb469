"""Addresses of the placing page: pairs are checked, guests change nothing, errors are told."""

import pytest

from core.errors import ScanError
from tests.ui.web.visits import visited
from ui.web.placing import MOST_PAIRS, placing_routes


class Placer:
    """Remembers what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[object] = []

    def fitted(self, photo_id, pairs):
        self.asked.append(("fit", photo_id, pairs))
        return {"count": len(pairs)}

    def save(self, photo_id, pairs, seat_id=""):
        if photo_id == "broken":
            raise ScanError(photo_id, "cannot be read.", "Repair it.")
        self.asked.append(("save", photo_id, pairs))
        return {"saved": "a.points"}

    def status(self):
        return {"state": "idle"}

    def start_run(self):
        self.asked.append("run")

    def cancel_run(self):
        self.asked.append("cancel")


def answers(*requests: tuple[str, object], guest: bool = False):
    """Status and answer of each request, and what the placer was asked for."""
    placer = Placer()

    async def visit(client):
        found = []
        for path, body in requests:
            answer = await client.post(path, json=body)
            json = answer.content_type == "application/json"
            found.append((answer.status, await (answer.json() if json else answer.text())))
        return found

    return visited(placing_routes(placer), visit, guest), placer.asked


def test_pairs_reach_the_placer_as_numbers__law():
    body = {"pairs": [[1, 2, 3, 4.5]]}
    found, asked = answers(("/fit/a", body), ("/points/a", body), ("/run", {}), ("/run/cancel", {}))
    assert [status for status, _ in found] == [200] * 4
    pairs = [(1.0, 2.0, 3.0, 4.5)]
    assert asked == [("fit", "a", pairs), ("save", "a", pairs), "run", "cancel"]


def test_guests_may_fit_and_nothing_else__law():
    body = {"pairs": []}
    found, asked = answers(
        ("/fit/a", body), ("/points/a", body), ("/run", {}), ("/run/cancel", {}), guest=True
    )
    assert [status for status, _ in found] == [200, 403, 403, 403]
    assert asked == [("fit", "a", [])]


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"pairs": [[1, 2, 3]]},
        {"pairs": [[1, 2, 3, "x"]]},
        {"pairs": [[1, 2, 3, 1e12]]},
        {"pairs": [[0, 0, 0, 0]] * (MOST_PAIRS + 1)},
    ],
)
def test_what_are_no_pairs_is_refused__truth(body):
    found, asked = answers(("/points/a", body))
    assert found[0][0] == 400
    assert asked == []


def test_an_error_comes_with_its_words__law():
    ((status, answer),), _ = answers(("/points/broken", {"pairs": []}))
    assert status == 409
    assert answer["error"]["values"]["cause"] == "cannot be read."
