"""The lessons, opened in the browser: which there are, what each shows, how answers are judged."""

import importlib.util
import math
import pkgutil
import secrets
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from app import lessons
from app.lessons import places
from app.lessons.sheet import Lesson, LessonError, Question, Shape, Slider, State, View
from core.errors import PhotogrammetryError
from core.said import say
from ui.review.looks import page_palette
from ui.web.access import Access
from ui.web.front import Front, FrontInputs, Opened
from ui.web.lessons import lesson_routes
from ui.words.catalogue import LANGUAGES, lesson_words

MOST_SEED = 2**31
REMEDY = "Compare it with the lessons of app/lessons, as docs/teaching.md shows."


def find_lessons(own: Path | None = None, block: Path | None = None) -> dict[str, Lesson]:
    """All lessons by name, in their order.

    Args:
        own: A teacher's file with one more.
        block: A block with truth whose places are matched; without one the teaching flight.

    Raises:
        LessonError: That file is no lesson.
    """
    modules = [
        import_module(f"{lessons.__name__}.{found.name}")
        for found in pkgutil.iter_modules(lessons.__path__)
    ]
    found = [module.LESSON for module in modules if hasattr(module, "LESSON")]
    if own is not None:
        found.append(read_lesson(own))
    if block is not None:
        found = [lesson for lesson in found if lesson.name != places.LESSON.name]
        found.append(places.lesson_on(block))
    ordered = sorted(found, key=lambda lesson: (lesson.letter, lesson.order, lesson.name))
    return {lesson.name: lesson for lesson in ordered}


def read_lesson(path: Path) -> Lesson:
    """A lesson of a file, tried out in the state it opens in.

    Raises:
        LessonError: The file cannot be run, has no lesson, or the lesson shows nothing.
    """
    spec = importlib.util.spec_from_file_location(f"own_{path.stem}", path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise LessonError(path, "is no Python file.", REMEDY)
    module = importlib.util.module_from_spec(spec)
    # Dataclasses of the file look their module up there.
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
        lesson = module.LESSON
        lesson.view(lesson.start)
        lesson.questions[0].ask(np.random.default_rng(0))
    except (
        SyntaxError,
        ImportError,
        AttributeError,
        NameError,
        TypeError,
        ValueError,
        LookupError,
        ArithmeticError,
        RuntimeError,
    ) as error:
        raise LessonError(path, say("does not work: {why}.", why=str(error)), REMEDY) from error
    return cast("Lesson", lesson)


class Teacher:
    """Shows lessons and judges answers; satisfies `ui.web.lessons.Teacher`.

    It remembers nothing: state and score belong to each student's page.
    """

    def __init__(self, found: Mapping[str, Lesson]) -> None:
        self._lessons = found

    def listed(self, language: str) -> dict[str, Any]:
        """All lessons with their sliders and formulas, and their texts."""
        texts = dict(lesson_words(language))
        for lesson in self._lessons.values():
            own = lesson.texts.get(language) or lesson.texts.get(LANGUAGES[0], {})
            texts |= {f"lesson.{lesson.name}.{key}": text for key, text in own.items()}
        told = [
            {
                "name": lesson.name,
                "letter": lesson.letter,
                "sliders": [_slider(slider) for slider in lesson.sliders],
                "equations": [plain(one) for one in lesson.equations],
                "questions": [one.name for one in lesson.questions],
                "truth": lesson.hides_truth,
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
        return {"name": question.name, "values": dict(asked.values), "unit": question.unit}

    def judge(self, name: str, which: int, seed: int, answer: float | None) -> dict[str, Any]:
        """Whether an answer is right; the right one with it where it is, or was given up.

        Raises:
            LessonError: No such question.
        """
        question = self._question(name, which)
        right = question.ask(np.random.default_rng(abs(seed) % MOST_SEED)).answer
        is_right = answer is not None and abs(answer - right) <= question.tolerance
        told = {"right": is_right, "tolerance": question.tolerance, "digits": question.digits}
        return {**told, "answer": right} if is_right or answer is None else told

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
    figures = {
        name: replace(number, truth=None)
        for name, number in view.figures.items()
        if not number.secret
    }
    canvases = tuple(
        replace(canvas, shapes=tuple(one for one in canvas.shapes if one.look != "truth"))
        for canvas in view.canvases
    )
    return replace(view, figures=figures, canvases=canvases)


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
    found: Mapping[str, Lesson], host: str, port: int, language: str = ""
) -> Teaching:
    """Open the page of lessons.

    Raises:
        PhotogrammetryError: The port cannot be had.
    """
    start = {"edition": secrets.token_urlsafe(6), "palette": page_palette(), "photos": []}
    doors = FrontInputs(
        Access(host),
        None,
        None,
        None,
        start,
        page="lessons.html",
        routes=lesson_routes(Teacher(found)),
        language=language,
    )
    opened = Teaching(Front(doors, host, port))
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
