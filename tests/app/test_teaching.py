"""The verb `teach`: its lessons, a teacher's own, states and answers, and wrong use."""

import csv
import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib import request

import pytest

from app.cli import main
from app.found_lessons import find_lessons
from app.lessons.sheet import LessonError
from app.teaching import Teacher, open_teaching, plain, state_of
from ui.web.access import Door

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
        ("def\n", "does not work in line 1: SyntaxError: invalid syntax"),
        ("A = 1\n\nB = A['pp']\n", "does not work in line 3: TypeError: 'int' object is not"),
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


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            '    "shadow",\n    "x",',
            '    "relief",\n    "x",',
            "name of a lesson of Gruber, relief",
        ),
        ('    "slider.sun": "Height of the sun",\n', "", "lacks texts (en): slider.sun"),
        (
            '    "hint.height": "Height over shadow',
            '    "hint.h": "Height over shadow',
            "hint.height",
        ),
        ('    "figure.shadow": "Shadow on the film",\n', "", "lacks texts (en): figure.shadow"),
        ('texts={"en": TEXTS}', 'texts={"en": TEXTS, "cs": {"title": "Stín"}}', "(cs): axis.s"),
        ('    texts={"en": TEXTS},\n', "", "lacks texts (en): axis.s"),
        ("def ask(rng):", "def ask(rng):\n    assert rng is None", "AssertionError"),
        ('"sun", 10, 70, 30', '"sun", 10, 70, 80', "opens with sun beyond its range"),
        ("(section,)", "section", "TypeError: 'Canvas' object is not iterable"),
        ("    return sheet.View(", "    sheet.View(", "AttributeError: 'NoneType'"),
        ('{"shadow": on_film}', '{"shadow": shadow_m}', "has no attribute 'secret'"),
        ('tan", "e"))),),', 'tan", "e")))),', "TypeError: 'Equation' object is not iterable"),
        ('"ground"),', '"grund"),', "uses names that nothing has: grund"),
        ('shape("arrow"', 'shape("arow"', "uses names that nothing has: arow"),
        ("on_film.value))\n", "on_film.value), 'lens')\n", "uses names that nothing has: lens"),
        ("A shadow is {shadow} m", "A shadow is {shade} m", "uses names that nothing has: shade"),
        ('    "slider.c":', '    "choice.c.85": "wide",\n    "slider.c":', "choice.c.100"),
        (
            "    sun = np.radians",
            "    assert state['h'] < 99, 'high'\n    sun = np.radians",
            "does not work in line 11: AssertionError: high",
        ),
    ],
)
def test_a_lesson_that_hides_another_lacks_words_or_cannot_open_is_refused__law(
    own: Path, old: str, new: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """One message with file, cause and remedy."""
    text = own.read_text(encoding="utf-8")
    assert old in text
    own.write_text(text.replace(old, new), encoding="utf-8")
    assert main(["teach", "--own", str(own), "--list"]) == 1
    said = capsys.readouterr().err
    assert str(own) in said
    assert told in " ".join(said.split())
    remedies = ("of its LESSON", "Give its LESSON", "Compare it with", "Start it between")
    assert any(remedy in " ".join(said.split()) for remedy in remedies)


def test_a_folder_without_a_block_or_a_truth_is_told_before_the_page_opens__law(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["teach", str(tmp_path / "typo"), "--no-browser", "--port", "0"]) == 1
    assert "There is no block" in " ".join(capsys.readouterr().err.split())
    (tmp_path / "block.toml").write_text("", encoding="utf-8")
    assert main(["teach", str(tmp_path), "--no-browser", "--port", "0"]) == 1
    assert "There is no truth" in " ".join(capsys.readouterr().err.split())


def test_a_lesson_that_breaks_in_one_state_says_so_there__law(own: Path) -> None:
    """Between the ends of its sliders, where nobody tried it; the others work."""
    text = own.read_text(encoding="utf-8")
    text = text.replace(
        "    sun = np.radians", "    assert state['h'] != 50, 'not 50'\n    sun = np.radians"
    )
    text = text.replace(
        "    shadow, sun =", "    assert rng.random() < 0.9, 'far'\n    shadow, sun ="
    )
    own.write_text(text, encoding="utf-8")
    teacher = Teacher(find_lessons(own))
    assert teacher.view("shadow", {"h": 51}, truth=False)["figures"]
    with pytest.raises(LessonError, match="line 11: AssertionError: not 50"):
        teacher.view("shadow", {"h": 50}, truth=False)
    with pytest.raises(LessonError, match="AssertionError: far"):
        _ = [teacher.question("shadow", 0, seed) for seed in range(99)]


def test_a_lesson_in_one_language_is_shown_in_it__law(own: Path) -> None:
    text = own.read_text(encoding="utf-8").replace('texts={"en"', 'texts={"cs"')
    own.write_text(text, encoding="utf-8")
    words = Teacher(find_lessons(own)).listed("en")["words"]
    assert words["lesson.shadow.title"] == "Shadows tell heights"


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


def attempt(answer: float | None, **other: object) -> dict[str, object]:
    """An answer as the page keeps it."""
    own = {"lesson": "corrections", "which": 0, "seed": 4, "when": "2026-01-02T03:04:05.000Z",
           "state": {"H": 4500, "r": 130.5}}  # fmt: skip
    return {**own, "answer": answer, **other}


def rows_of(table: bytes) -> list[dict[str, str]]:
    """The table as a spreadsheet reads it: its mark says UTF-8."""
    assert table.startswith(b"\xef\xbb\xbf")
    return list(csv.DictReader(table.decode("utf-8-sig").splitlines()))


def test_each_attempt_has_a_row_with_what_was_right__law() -> None:
    teacher = Teacher(find_lessons())
    right = teacher.judge("corrections", 0, 4, None)["answer"]
    rows = rows_of(teacher.table("Žofie Dvořáková", [attempt(1e6), attempt(right), attempt(None)]))
    assert [row["result"] for row in rows] == ["wrong", "right", "given up"]
    assert {row["student"] for row in rows} == {"Žofie Dvořáková"}
    first, asked = rows[0], teacher.question("corrections", 0, 4)["values"]
    assert first["when"] == "2026-01-02T03:04:05.000Z"
    assert (first["lesson"], first["question"], first["seed"]) == ("corrections", "curvature", "4")
    assert first["asked"] == " ".join(f"{name}={value:g}" for name, value in asked.items())
    assert (float(first["answer"]), rows[2]["answer"]) == (1e6, "")
    assert float(first["right_answer"]) == pytest.approx(right, abs=0.005)
    assert (first["unit"], first["tolerance"]) == ("µm", "2.0")
    assert first["sliders"] == "H=4500 r=130.5"


def test_no_spreadsheet_runs_what_a_student_wrote__law() -> None:
    """Name, lesson and sliders come from the browser, and may be made up."""
    evil = '=HYPERLINK("http://x.example";"a")'
    row = rows_of(
        Teacher(find_lessons()).table(
            evil, [attempt(1, lesson=evil, when="@SUM(A1)", state={"=1+1": "+cmd|'/c calc'!A0"})]
        )
    )[0]
    assert not [cell for cell in row.values() if cell.startswith(("=", "@", "+", "\t"))]
    assert row["student"] == f"'{evil}"
    assert row["right_answer"] == ""


def test_students_come_by_their_own_address_and_see_no_hidden_truth__law() -> None:
    """Of all lessons, whatever the page asks for; the teacher's address shows it."""
    asked = {"state": {}, "truth": True}
    for hide in (False, True):
        with open_teaching(find_lessons(), Door(), hide_truth=hide) as page:
            for url, shown in ((page.url, True), (page.guest_url, not hide)):
                with visitor(url) as (get, post):
                    view = post("/lesson/stereo", asked)
                    assert ("height" in view["figures"]) is shown
                    looks = {s["look"] for c in view["canvases"] for s in c["shapes"]}
                    assert ("truth" in looks) is shown
                    listed = get("/lessons/en")["lessons"]
                    assert any(one["truth"] for one in listed) is shown
                    assert get("/start")["invitation"] == page.guest_url


@contextmanager
def visitor(url: str) -> Iterator[tuple[Callable[..., Any], Callable[..., Any]]]:
    """A browser that came by an address: what it gets and posts."""
    jar = request.HTTPCookieProcessor()
    browser = request.build_opener(jar)
    browser.open(url).close()
    home = url.split("/?")[0]

    def ask(path: str, body: object = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        with browser.open(request.Request(home + path, data)) as answer:
            return json.load(answer)

    yield ask, ask


def test_the_page_opens_at_an_address_with_a_token__law() -> None:
    with open_teaching(find_lessons(), Door()) as page:
        assert page.url.startswith(f"http://127.0.0.1:{page.port}/?token=")
