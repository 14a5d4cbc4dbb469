"""Which lessons there are: those of Gruber, and a teacher's own, tried out before it is shown."""

import importlib.util
import pkgutil
import re
import sys
import traceback
from collections.abc import Collection, Generator
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import NoReturn, get_args

import numpy as np

from app import lessons
from app.lessons import places
from app.lessons.sheet import Asked, Kind, Lesson, LessonError, Look, Question, State, View
from app.teaching import Teacher, plain, shown
from core.said import say
from ui.words.catalogue import LANGUAGES

REMEDY = "Compare it with the lessons of app/lessons, as docs/python/lessons.md shows."


def find_lessons(own: Path | None = None, block: Path | None = None) -> dict[str, Lesson]:
    """All lessons by name, in their order.

    Args:
        own: A teacher's file with one more.
        block: A block with truth whose places are matched; without one the teaching flight.

    Raises:
        LessonError: That file is no lesson, is named as another, or lacks texts.
    """
    modules = [
        import_module(f"{lessons.__name__}.{found.name}")
        for found in pkgutil.iter_modules(lessons.__path__)
    ]
    found = [module.LESSON for module in modules if hasattr(module, "LESSON")]
    if own is not None:
        found.append(_one_more(own, {lesson.name for lesson in found}))
    if block is not None:
        found = [lesson for lesson in found if lesson.name != places.LESSON.name]
        found.append(places.lesson_on(block))
    ordered = sorted(found, key=lambda lesson: (lesson.letter, lesson.order, lesson.name))
    return {lesson.name: lesson for lesson in ordered}


def _one_more(own: Path, names: Collection[str]) -> Lesson:
    """A teacher's lesson beside others of these names, with all its texts."""
    lesson = read_lesson(own)
    if lesson.name in names:
        wrong = say("has the name of a lesson of Gruber, {name}.", name=lesson.name)
        raise LessonError(own, wrong, "Give its LESSON another name.")
    with _faults_of(own):
        keys = text_keys(lesson)
    for language, texts in lesson.texts.items() or {LANGUAGES[0]: {}}.items():
        if missing := sorted((keys | choice_keys(lesson, texts)) - set(texts)):
            lacks = say("lacks texts ({language}): {keys}.", language=language, keys=missing)
            raise LessonError(own, lacks, "Write them into the texts of its LESSON.")
        for one in lesson.questions:
            numbers = one.ask(np.random.default_rng(0)).values
            places = re.findall(r"\{(\w+)\}", texts[f"question.{one.name}"])
            if unknown := sorted(set(places) - set(numbers)):
                _misnamed(own, unknown)
    return lesson


def choice_keys(lesson: Lesson, texts: Collection[str]) -> set[str]:
    """The texts of all values of the sliders whose first value has one."""
    return {
        f"choice.{one.name}.{value:g}"
        for one in lesson.sliders
        if f"choice.{one.name}.{one.low:g}" in texts
        for value in np.arange(one.low, one.high + one.step / 2, one.step)
    }


def text_keys(lesson: Lesson) -> set[str]:
    """The texts that a lesson shows as it opens, and at both ends of each slider.

    A label without a text is shown as it is.
    """
    keys = {"title", "idea", "try", "source"} | {f"slider.{one.name}" for one in lesson.sliders}
    for one in lesson.questions:
        keys |= {f"{part}.{one.name}" for part in ("question", "hint")}
        keys |= {f"sign.{one.name}"} if one.signed else set()
    steps = [one for one in lesson.sliders if one.name == "step"]
    ends = [(one.name, value) for one in lesson.sliders for value in (one.low, one.high)]
    ends += [(one.name, value) for one in steps for value in np.arange(one.low, one.high)]
    for name, value in [("", 0.0), *ends]:
        # Some states show nothing, which the page tells.
        with suppress(ArithmeticError, np.linalg.LinAlgError):
            keys |= view_keys(lesson.view(lesson.start | ({name: float(value)} if name else {})))
    return keys


def view_keys(view: View) -> set[str]:
    """The texts of one state; labels apart."""
    keys = {f"idle.{reason}" for reason in view.idle.values()}
    keys |= {f"warning.{view.warning}"} if view.warning else set()
    keys |= {f"{part}.{view.step}" for part in ("step", "source_of") if view.step}
    keys |= {f"figure.{one}" for one in view.figures}
    keys |= {f"canvas.{one.name}" for one in view.canvases}
    if view.plot is not None:
        keys |= {f"axis.{one}" for one in (view.plot.x, view.plot.y)}
        # One line alone is named by its axis.
        keys |= {f"curve.{one.name}" for one in view.plot.curves if len(view.plot.curves) > 1}
    return keys


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
    with _faults_of(path):
        spec.loader.exec_module(module)
        lesson = told_faults(module.LESSON, path)
        plain(shown(lesson.view(lesson.start), truth=False))
        for question in lesson.questions:
            question.ask(np.random.default_rng(0))
        Teacher({lesson.name: lesson}).listed(LANGUAGES[0])
    for one in lesson.sliders:
        if not one.low <= one.start <= one.high:
            out = say("opens with {name} beyond its range.", name=one.name)
            raise LessonError(path, out, "Start it between its least and greatest value.")
    return lesson


def told_faults(lesson: Lesson, path: Path) -> Lesson:
    """A lesson of a file whose faults are told in each state, by line where they have one."""

    def view(state: State) -> View:
        with _faults_of(path, but=(ArithmeticError, np.linalg.LinAlgError)):
            seen = lesson.view(state)
            if unknown := unknown_names(lesson, seen):
                _misnamed(path, unknown)
            return seen

    def told(question: Question) -> Question:
        def ask(rng: np.random.Generator) -> Asked:
            with _faults_of(path):
                return question.ask(rng)

        return replace(question, ask=ask)

    return replace(lesson, view=view, questions=tuple(told(one) for one in lesson.questions))


def unknown_names(lesson: Lesson, view: View) -> list[str]:
    """What a view calls by a name that no slider, look or kind of shape has."""
    named = {*view.idle, *view.in_force}
    if view.plot is not None and view.plot.kinds:
        named.add(view.plot.kinds)
    shapes = [shape for canvas in view.canvases for shape in canvas.shapes]
    unknown = named - {one.name for one in lesson.sliders}
    unknown |= {shape.look for shape in shapes} - set(get_args(Look))
    unknown |= {shape.kind for shape in shapes} - set(get_args(Kind))
    return sorted(unknown)


def _misnamed(path: Path, names: list[str]) -> NoReturn:
    """Tell that nothing is called so."""
    raise LessonError(path, say("uses names that nothing has: {names}.", names=names), REMEDY)


@contextmanager
def _faults_of(path: Path, but: tuple[type[Exception], ...] = ()) -> Generator[None]:
    """Tell what breaks a lesson of a file, but for errors that somebody else tells."""
    try:
        yield
    except but:
        raise
    except (
        AssertionError,
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
        raise LessonError(path, _why(error, path), REMEDY) from error


def _why(error: Exception, path: Path) -> str:
    """What broke a lesson, and in which line of its file it did."""
    why = f"{type(error).__name__}: {error}".removesuffix(": ")
    own = [
        part.lineno
        for part in traceback.extract_tb(error.__traceback__)
        if Path(part.filename) == path
    ]
    line = error.lineno if isinstance(error, SyntaxError) else own[-1] if own else None
    if line is None:
        return say("does not work: {why}.", why=why)
    return say("does not work in line {line}: {why}.", line=line, why=why)
