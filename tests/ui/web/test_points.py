"""Addresses of lists of points: operators only, whole bodies, plain readings."""

import json
from io import BytesIO

from tests.ui.web.visits import visited
from ui.web.points import MOST_BYTES, point_routes


class Door:
    """Remembers what it was given."""

    def __init__(self) -> None:
        self.given: list[tuple[object, ...]] = []

    def read(self, name, data, reading):
        self.given.append(("read", name, data, reading))
        return {"points": []}

    def bring(self, seat_id, name, data, reading):
        self.given.append(("bring", seat_id, name, data, reading))
        return {"brought": 1}

    def known(self, name):
        return {"name": name}


def statuses(door, *asked, guest=False):
    async def visit(client):
        answers = []
        for method, path, data in asked:
            answers.append((await client.request(method, path, data=BytesIO(data or b""))).status)
        return answers

    return visited(point_routes(door), visit, guest)


def test_a_list_and_its_reading_arrive_whole__truth():
    door = Door()
    reading = json.dumps({"decimal": ","})
    body = b"A,1,2,3\n" * 200_000  # more than a form may hold by itself
    path = f"?name=a.csv&seat=s&reading={reading}"
    asked = ("POST", f"/points/read{path}", body), ("POST", f"/points/bring{path}", body)
    assert statuses(door, *asked) == [200, 200]
    assert door.given == [
        ("read", "a.csv", body, {"decimal": ","}),
        ("bring", "s", "a.csv", body, {"decimal": ","}),
    ]


def test_guests_bring_nothing__law():
    door = Door()
    asked = ("POST", "/points/read", b"a"), ("POST", "/points/bring", b"a")
    assert statuses(door, *asked, ("GET", "/points/known?name=A", None), guest=True) == [403] * 3
    assert door.given == []


def test_what_is_no_reading_or_too_large_is_refused__law():
    door = Door()
    asked = ("POST", "/points/read?reading=[", b"a"), ("POST", "/points/read?reading=[]", b"a")
    assert statuses(door, *asked) == [400, 400]
    assert statuses(door, ("POST", "/points/read", bytes(MOST_BYTES + 1))) == [413]
