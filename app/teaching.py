"""The lessons, opened in the browser: what each shows, how answers are judged."""

import math
import secrets
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from typing import Any, cast

import numpy as np

from app.lessons.sheet import (
    Lesson,
    LessonError,
    Question,
    Shape,
    Slider,
    State,
    View,
)
from core.errors import PhotogrammetryError
from core.formats.records import spreadsheet_bytes
from core.said import say
from ui.review.looks import page_palette
from ui.web.access import Access, Door
from ui.web.front import Front, FrontInputs, Opened
from ui.web.lessons import lesson_routes
from ui.words.catalogue import lesson_words

MOST_SEED = 2**31
COLUMNS = ("when", "student", "lesson", "question", "asked", "answer", "right_answer", "unit",
           "tolerance", "result", "sliders", "seed")  # fmt: skip
"""Of the table of answers."""


class Teacher:
    """Shows lessons and judges answers; satisfies `ui.web.lessons.Teacher`.

    It remembers nothing: state and score belong to each student's page.
    """

    def __init__(self, found: Mapping[str, Lesson]) -> None:
        self._lessons = found

    def listed(self, language: str, truth: bool = True) -> dict[str, Any]:
        """All lessons with their sliders and formulas, and their texts.

        Args:
            language: Of the texts.
            truth: Whether the truth can be shown at all.
        """
        texts = dict(lesson_words(language))
        for lesson in self._lessons.values():
            # A lesson in one language is shown in that.
            own = lesson.texts.get(language) or next(iter(lesson.texts.values()), {})
            texts |= {f"lesson.{lesson.name}.{key}": text for key, text in own.items()}
        told = [
            {
                "name": lesson.name,
                "letter": lesson.letter,
                "sliders": [_slider(slider) for slider in lesson.sliders],
                "equations": [plain(one) for one in lesson.equations],
                "questions": [one.name for one in lesson.questions],
                "truth": lesson.hides_truth and truth,
            }
            for lesson in self._lessons.values()
        ]
        return {"lessons": told, "words": texts}

    def view(self, name: str, values: Mapping[str, Any], truth: bool) -> dict[str, Any]:
        """What a lesson shows in a state.

        Raises:
            LessonError: No such lesson, a state that its sliders cannot have, or one that has no
            picture.
        """
        lesson = self._lesson(name)
        state = state_of(lesson, values)
        try:
            seen = lesson.view(state)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise LessonError(
                name, "shows nothing with these values.", "Move the slider back."
            ) from error
        return plain(shown(seen, truth))

    def question(self, name: str, which: int, seed: int) -> dict[str, Any]:
        """A question with its numbers.

        Raises:
            LessonError: No such question.
        """
        question = self._question(name, which)
        asked = question.ask(np.random.default_rng(abs(seed) % MOST_SEED))
        values = dict(asked.values)
        return {
            "name": question.name, "values": values, "unit": question.unit,
            "signed": question.signed,
        }  # fmt: skip

    def judge(self, name: str, which: int, seed: int, answer: float | None) -> dict[str, Any]:
        """Whether an answer is right; the right one with it where it is, or was given up.

        `opposite` says that the amount is right, and its sign is not.

        Raises:
            LessonError: No such question.
        """
        question = self._question(name, which)
        asked = question.ask(np.random.default_rng(abs(seed) % MOST_SEED))
        right, within = asked.answer, question.tolerance
        within = within if asked.tolerance is None else asked.tolerance
        is_right = answer is not None and abs(answer - right) <= within
        opposite = answer is not None and abs(answer + right) <= within
        told = {
            "right": is_right, "opposite": opposite and not is_right,
            "tolerance": within, "digits": question.digits,
        }  # fmt: skip
        return {**told, "answer": right} if is_right or answer is None else told

    def table(self, student: str, attempts: Sequence[Mapping[str, Any]]) -> bytes:
        """A row for each attempt of a student, for a spreadsheet: UTF-8 with its mark.

        Args:
            student: A name.
            attempts: `lesson`, `which`, `seed`, `answer` (None: given up), `when`, and the
                `state` of the sliders, each as the page kept it.
        """
        return spreadsheet_bytes([COLUMNS, *(self._row(student, one) for one in attempts)])

    def _row(self, student: str, given: Mapping[str, Any]) -> list[object]:
        name, which, seed, answer = (given[key] for key in ("lesson", "which", "seed", "answer"))
        state = " ".join(f"{slider}={value}" for slider, value in given["state"].items())
        try:
            question, told = self._question(name, which), self.judge(name, which, seed, None)
        except LessonError:
            # A teacher's lesson that is not open now: what is known is kept.
            return [given["when"], student, name, "", "", answer, "", "", "", "", state, seed]
        asked = question.ask(np.random.default_rng(abs(seed) % MOST_SEED)).values
        is_right = self.judge(name, which, seed, answer)["right"]
        result = "given up" if answer is None else "right" if is_right else "wrong"
        values = " ".join(f"{key}={value:g}" for key, value in asked.items())
        right = round(told["answer"], question.digits + 2)
        return [given["when"], student, name, question.name, values, answer, right, question.unit,
                told["tolerance"], result, state, seed]  # fmt: skip

    def _lesson(self, name: str) -> Lesson:
        lesson = self._lessons.get(name)
        if lesson is None:
            raise LessonError(name, "is no lesson.", "Load the page again.")
        return lesson

    def _question(self, name: str, which: int) -> Question:
        questions = self._lesson(name).questions
        if not 0 <= which < len(questions):
            raise LessonError(name, "has no such question.", "Load the page again.")
        return questions[which]


def state_of(lesson: Lesson, values: Mapping[str, Any]) -> State:
    """The state that values make; sliders without one stand where the lesson opens.

    Raises:
        LessonError: A name no slider has, or a value none can have.
    """
    state = dict(lesson.start)
    limits = {slider.name: slider for slider in lesson.sliders}
    for name, value in values.items():
        slider = limits.get(name)
        number = value if isinstance(value, int | float) else math.nan
        if slider is None or not slider.low <= number <= slider.high:
            raise LessonError(
                lesson.name,
                say("has no {name} of {value}.", name=name, value=str(value)),
                "Load the page again.",
            )
        state[name] = float(number)
    return state


def shown(view: View, truth: bool) -> View:
    """A view as it is sent: without what was put in, unless that is to be seen."""
    if truth:
        return view
    symbols = {
        name: one if isinstance(one, list) else replace(one, truth=None)
        for name, one in view.symbols.items()
        if isinstance(one, list) or not one.secret
    }
    canvases = tuple(
        replace(canvas, shapes=tuple(bare(one) for one in canvas.shapes if one.look != "truth"))
        for canvas in view.canvases
    )
    figures = {
        name: replace(number, truth=None)
        for name, number in view.figures.items()
        if not number.secret
    }
    return replace(view, figures=figures, symbols=symbols, canvases=canvases)


def bare(one: Shape) -> Shape:
    """A shape whose number tells no truth."""
    return one if one.number is None else replace(one, number=replace(one.number, truth=None))


def plain(value: Any) -> Any:
    """A value as JSON has it: dataclasses as objects, what is not finite as null."""
    match value:
        case Shape():
            # Points are plain and finite already, and most of what is sent.
            rest = {
                "label": value.label,
                "number": plain(value.number),
                "handle": value.handle,
                "below": value.below,
            }
            own = {name: one for name, one in rest.items() if one}
            return {"kind": value.kind, "points": value.points, "look": value.look, **own}
        case float() | np.floating():
            return float(value) if math.isfinite(value) else None
        case np.integer() | np.bool_():
            return value.item()
        case Mapping():
            inside = cast("Mapping[str, Any]", value)
            return {name: plain(one) for name, one in inside.items()}
        case list() | tuple():
            return [plain(one) for one in cast("Sequence[Any]", value)]
        case _ if is_dataclass(value):
            return {one.name: plain(getattr(value, one.name)) for one in fields(value)}
        case _:
            return value


def _slider(slider: Slider) -> dict[str, Any]:
    return {**plain(slider), "switch": slider.is_switch}


class Teaching(Opened):
    """The open lessons."""

    def wait(self) -> None:
        """Until Ctrl-C."""
        threading.Event().wait()


def open_teaching(
    found: Mapping[str, Lesson],
    door: Door,
    language: str = "",
    hide_truth: bool = False,
) -> Teaching:
    """Open the page of lessons.

    Args:
        found: The lessons.
        door: Where it listens.
        language: Of the texts until a page chooses; that of each browser when empty.
        hide_truth: Students, who come by a link, never get the truth.

    Raises:
        PhotogrammetryError: The port cannot be had.
    """
    start = {"edition": secrets.token_urlsafe(6), "palette": page_palette(), "photos": []}
    served = FrontInputs(
        Access(door),
        None,
        None,
        None,
        start,
        page="lessons.html",
        told=lambda: {"invitation": opened.guest_url},
        routes=lesson_routes(Teacher(found), hide_truth),
        language=language,
    )
    opened = Teaching(Front(served))
    opened.listen()
    threading.Thread(target=_prepare, args=(found,), daemon=True).start()
    return opened


def _prepare(found: Mapping[str, Lesson]) -> None:
    """Do beforehand what the first view of a lesson would wait for."""
    for lesson in found.values():
        if lesson.prepare is not None:
            # What fails here is told by the lesson itself, to who opens it.
            with suppress(PhotogrammetryError):
                lesson.prepare()
