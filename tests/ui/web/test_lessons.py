"""Addresses of the lessons: states are checked, guests may learn, errors are told."""

import asyncio
import threading

import pytest

from core.errors import ScanError
from tests.ui.web.visits import visited
from ui.web import lessons
from ui.web.lessons import MOST_SLIDERS, lesson_routes

ATTEMPT = {"lesson": "relief", "which": 0, "seed": 1, "when": "now", "state": {}, "answer": None}


class Teacher:
    """Remembers what it was asked."""

    def __init__(self) -> None:
        self.asked: list[object] = []

    def listed(self, language, truth):
        return {"lessons": [], "words": {"language": language}, "truth": truth}

    def view(self, name, values, truth):
        if name == "alchemy":
            raise ScanError(name, "is no lesson.", "Load the page again.")
        self.asked.append((name, dict(values), truth))
        return {"figures": {}}

    def question(self, name, which, seed):
        return {"name": name, "which": which, "seed": seed}

    def judge(self, name, which, seed, answer):
        self.asked.append((name, which, seed, answer))
        return {"right": answer == 5}

    def table(self, student, attempts):
        self.asked.append((student, attempts))
        return f"{student}\n".encode("utf-8-sig")


def answers(*requests: tuple[str, object], guest: bool = True, hide_truth: bool = False):
    """Status and answer of each request, and what the teacher was asked."""
    teacher = Teacher()

    async def visit(client):
        found = []
        for path, body in requests:
            answer = await (client.get(path) if body is None else client.post(path, json=body))
            json = answer.content_type == "application/json"
            found.append((answer.status, await (answer.json() if json else answer.text())))
        return found

    return visited(lesson_routes(teacher, hide_truth), visit, guest), teacher.asked


def test_a_state_reaches_the_lesson_and_guests_may_learn__law():
    found, asked = answers(
        ("/lessons/cs", None),
        ("/lesson/relief", {"state": {"h": 3}, "truth": True}),
        ("/lesson/relief", {"state": {"h": 3}}),
        ("/lesson/relief/question", {"which": 0, "seed": 4}),
        ("/lesson/relief/answer", {"which": 0, "seed": 4, "answer": 5}),
        ("/lesson/relief/answer", {"which": 0, "seed": 4, "answer": None}),
    )
    assert [status for status, _ in found] == [200] * 6
    assert found[0][1]["words"] == {"language": "cs"}
    assert asked == [
        ("relief", {"h": 3}, True),
        ("relief", {"h": 3}, False),
        ("relief", 0, 4, 5),
        ("relief", 0, 4, None),
    ]
    assert [answer.get("right") for _, answer in found[4:]] == [True, False]


@pytest.mark.parametrize(("guest", "seen"), [(True, False), (False, True)])
def test_hidden_truth_reaches_the_teacher_and_no_student__law(guest, seen):
    found, asked = answers(
        ("/lessons/en", None), ("/lesson/relief", {"state": {}, "truth": True}),
        guest=guest, hide_truth=True,
    )  # fmt: skip
    assert found[0][1]["truth"] is seen
    assert asked == [("relief", {}, seen)]


class SlowTeacher(Teacher):
    """Counts the views at work; the one named `slow` lasts until another was asked for after it."""

    def __init__(self) -> None:
        super().__init__()
        self.at_work, self.most = 0, 0
        self.begun, self.other = threading.Event(), threading.Event()

    def view(self, name, values, truth):
        self.at_work += 1
        self.most = max(self.most, self.at_work)
        self.begun.set()
        if name == "slow":
            assert self.other.wait(30)
        else:
            self.other.set()
        self.at_work -= 1
        return super().view(name, values, truth)


def test_views_take_turns__law():
    teacher = SlowTeacher()

    async def visit(client):
        asked = (client.post("/lesson/relief", json={"state": {"h": i}}) for i in range(8))
        return [answer.status for answer in await asyncio.gather(*asked)]

    assert visited(lesson_routes(teacher), visit, True) == [200] * 8
    assert teacher.most == 1


def test_a_slow_lesson_holds_up_nobody__law(monkeypatch):
    monkeypatch.setattr(lessons, "PATIENCE_S", 0.1)
    teacher = SlowTeacher()

    async def visit(client):
        slow = asyncio.create_task(client.post("/lesson/slow", json={"state": {}}))
        assert await asyncio.to_thread(teacher.begun.wait, 30)
        return [
            (await client.post("/lesson/relief", json={"state": {}})).status,
            (await slow).status,
        ]

    assert visited(lesson_routes(teacher), visit, True) == [200, 200]
    assert [name for name, *_ in teacher.asked] == ["relief", "slow"]


def test_a_table_of_answers_is_made_by_the_engine__law():
    found, asked = answers(("/answers", {"student": "Žofie", "attempts": [ATTEMPT]}))
    assert found == [(200, "\ufeffŽofie\n")]
    assert asked == [("Žofie", [ATTEMPT])]


def test_an_unknown_lesson_is_told_in_words__law():
    found, _ = answers(("/lesson/alchemy", {"state": {}}))
    assert found[0][0] == 409
    assert found[0][1]["error"]["values"]["file"] == "alchemy"


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/lesson/relief", {}),
        ("/lesson/relief", []),
        ("/lesson/relief", {"state": [1]}),
        ("/lesson/relief", {"state": {f"{i}": 1 for i in range(MOST_SLIDERS + 1)}}),
        ("/lesson/relief/question", {"which": "0", "seed": 1}),
        ("/lesson/relief/question", {"which": 0}),
        ("/lesson/relief/answer", {"which": 0, "seed": 1, "answer": "five"}),
        ("/answers", {"student": "A"}),
        ("/answers", {"student": 1, "attempts": []}),
        ("/answers", {"student": "A", "attempts": [1]}),
        ("/answers", {"student": "A", "attempts": [ATTEMPT | {"answer": "five"}]}),
        ("/answers", {"student": "A", "attempts": [ATTEMPT | {"state": "none"}]}),
    ],
)
def test_nonsense_is_refused__law(path, body):
    found, asked = answers((path, body))
    assert found[0][0] == 400
    assert not asked


def test_a_language_without_texts_is_not_there__law():
    assert answers(("/lessons/tlh", None))[0][0][0] == 404
