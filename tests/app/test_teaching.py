"""The verb `teach`: its lessons, a teacher's own, states and answers, and wrong use."""

import math
from pathlib import Path

import pytest

from app.cli import main
from app.lessons.sheet import LessonError
from app.teaching import Teacher, find_lessons, open_teaching, plain, state_of

pytestmark = pytest.mark.usefixtures("teaching_cache")
OWN = Path(__file__).parents[2] / "docs" / "python" / "lessons.md"


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """The lesson that the page for teachers shows, written out as it stands there."""
    path = tmp_path / "shadow.py"
    text = OWN.read_text(encoding="utf-8")
    path.write_text(text.split("```python\n", 1)[1].split("```", 1)[0], encoding="utf-8")
    return path


def test_list_names_every_lesson_with_its_title__law(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["teach", "--list"]) == 0
    told = capsys.readouterr().out
    assert all(f"{name}: " in told for name in find_lessons())
    assert main(["teach", "--list", "--language", "cs"]) == 0
    assert "relief: Radiální posun" in capsys.readouterr().out


def test_an_unknown_lesson_ends_with_two_and_names_the_others__law(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["teach", "--lesson", "alchemy"])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert "alchemy is no lesson" in told
    assert all(name in told for name in find_lessons())


def test_a_lesson_of_the_manual_works_as_it_stands__law(own: Path) -> None:
    lessons = find_lessons(own)
    lesson = lessons["shadow"]
    assert own.read_text(encoding="utf-8").count("\n") < 80
    told = Teacher(lessons).listed("en")["words"]
    assert told["lesson.shadow.title"]
    assert Teacher(lessons).listed("cs")["words"]["lesson.shadow.title"]
    view = Teacher(lessons).view("shadow", {}, truth=False)
    assert all(one["value"] is not None for one in view["figures"].values())
    high = Teacher(lessons).view("shadow", {lesson.sliders[0].name: lesson.sliders[0].high}, False)
    assert high["figures"] != view["figures"]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("LESSON = 1\n", "no attribute"),
        ("import nowhere_at_all\n", "nowhere_at_all"),
        ("def\n", "invalid syntax"),
        ("A = 1\n", "LESSON"),
    ],
)
def test_a_file_that_is_no_lesson_is_named_with_its_cause__law(
    tmp_path: Path, text: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "broken.py"
    path.write_text(text, encoding="utf-8")
    assert main(["teach", "--own", str(path), "--list"]) == 1
    told = capsys.readouterr().err
    assert str(path) in told
    assert why in told


@pytest.mark.parametrize("asked", [["--list"], ["--lesson", "relief"]])
def test_a_missing_file_is_named__law(asked: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["teach", "--own", "nowhere.py", *asked]) == 1
    assert "nowhere.py" in capsys.readouterr().err


@pytest.mark.parametrize(
    "values",
    [{"r": 1e9}, {"r": -1}, {"x": 1}, {"r": math.nan}, {"r": "90"}, {"r": None}, {"r": math.inf}],
)
def test_a_state_no_slider_can_have_is_refused__law(values: dict) -> None:
    with pytest.raises(LessonError):
        state_of(find_lessons()["relief"], values)


def test_what_a_lesson_lacks_is_refused__law() -> None:
    teacher = Teacher(find_lessons())
    for ask in (
        lambda: teacher.view("alchemy", {}, False),
        lambda: teacher.question("relief", 9, 1),
        lambda: teacher.judge("relief", -1, 1, 3.0),
    ):
        with pytest.raises(LessonError):
            ask()


def test_a_question_has_the_same_numbers_for_the_same_seed__law() -> None:
    teacher = Teacher(find_lessons())
    assert teacher.question("relief", 0, 7) == teacher.question("relief", 0, 7)
    assert teacher.question("relief", 0, 7) != teacher.question("relief", 0, 8)


def test_what_is_not_finite_is_sent_as_nothing__law() -> None:
    assert plain({"a": math.nan, "b": [1.0, math.inf]}) == {"a": None, "b": [1.0, None]}


def test_the_page_opens_at_an_address_with_a_token__law() -> None:
    with open_teaching(find_lessons(), "127.0.0.1", 0) as page:
        assert page.url.startswith(f"http://127.0.0.1:{page.port}/?token=")
