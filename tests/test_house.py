"""Rules of the house that no linter knows, and documents that tell the truth."""

import argparse
import ast
import re
import subprocess
from functools import cache
from pathlib import Path

import pytest

from app.arguments import stage_names
from app.cli import parser
from app.misfit import COLUMNS as MISFIT_COLUMNS
from app.report.tables import (
    CHECK_COLUMNS,
    CONTROL_COLUMNS,
    EXTERIOR_COLUMNS,
    INTERIOR_COLUMNS,
    TIE_COLUMNS,
)
from core.doubts import GRAVITY
from sessions import replay
from sessions.decisions import DECISIONS
from sessions.layers import FOOTPRINTS, MEASUREMENTS, PHOTOS, POINTS
from ui.words.catalogue import KEYS, words

HOME = Path(__file__).resolve().parents[1]
ROOMS = ("gruber", "app", "core", "sessions", "ui")
LONGEST_FILE, LONGEST_FUNCTION, LONGEST_LINE = 500, 60, 100
MOST_WORDS = 9_000
"""Of the manual: what a user reads in an hour."""
HOMELESS = {"utils", "common", "helpers", "types", "misc"}
BROAD = {"app/desk/background.py", "ui/views/server.py"}
"""Where an error may be caught whatever it is, and not raised again."""
MACHINE_PATHS = re.compile(r"(?<![\w.])/(?:work|root|tmp|home)/")
FROM_NETWORK = re.compile(
    r"""(?:src|href|action)\s*=\s*["'](?:https?:)?//|@import|url\(\s*["']?(?:https?:)?//"""
    r"""|(?:from|import)\s*\(?\s*["'](?:https?:)?//|fetch\(\s*["'`]https?://"""
)


@cache
def tracked() -> tuple[str, ...]:
    """Files of the project, as git knows them; those not yet added as well."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=HOME, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout: there is no list of the project's files")
    return tuple(name for name in listed.stdout.splitlines() if (HOME / name).is_file())


def named(*endings: str, rooms: tuple[str, ...] = ()) -> list[str]:
    """Files with one of the endings, within the rooms if any are given."""
    found = [name for name in tracked() if name.endswith(endings)]
    return [name for name in found if not rooms or name.split("/")[0] in rooms]


@cache
def text_of(name: str) -> str:
    return (HOME / name).read_text(encoding="utf-8")


@cache
def tree_of(name: str) -> ast.Module:
    return ast.parse(text_of(name))


def imported(name: str) -> set[str]:
    """Top names of all that a module imports."""
    found: set[str] = set()
    for node in ast.walk(tree_of(name)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").split(".")[0])
    return found


def manual() -> list[str]:
    """Pages of the manual; the notebook below `docs/measurements` is none of it."""
    return [name for name in named(".md") if Path(name).parent.as_posix() == "docs"]


def table_under(page: str, heading: str) -> list[list[str]]:
    """Rows of the first table after a line of a page, without their head."""
    after = text_of(page).split(heading, 1)[1]
    rows = re.search(r"\n\|[^\n]*\n\|[-| ]+\n((?:\|[^\n]*\n)+)", after)
    assert rows is not None, f"{page} has no table under {heading}"
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[1].splitlines()]


def test_every_module_says_what_it_is__law() -> None:
    silent = [name for name in named(".py") if not ast.get_docstring(tree_of(name))]
    assert not silent


def test_each_module_of_the_desk_has_a_test_beside_its_name__law() -> None:
    modules = [Path(n) for n in named(".py") if n.startswith(("ui/", "app/desk/"))]
    beside = {
        module.as_posix(): HOME / "tests" / module.with_name(f"test_{module.name}")
        for module in modules
        if module.name != "__init__.py"
    }
    assert len(beside) > 25
    assert not [name for name, test in beside.items() if not test.is_file()]


def test_files_are_short__law() -> None:
    lengths = {name: text_of(name).count("\n") for name in named(".py", rooms=ROOMS)}
    assert not {name: length for name, length in lengths.items() if length > LONGEST_FILE}


def test_functions_are_short__law() -> None:
    long = {
        f"{name}: {node.name}": node.end_lineno - node.lineno + 1
        for name in named(".py", rooms=ROOMS)
        for node in ast.walk(tree_of(name))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno
    }
    assert not {where: lines for where, lines in long.items() if lines > LONGEST_FUNCTION}


def test_no_module_is_homeless__law() -> None:
    assert not [
        name
        for name in named(".py", rooms=ROOMS)
        if HOMELESS & set(Path(name).with_suffix("").parts)
    ]


def test_only_the_command_prints__law() -> None:
    printing = {
        name
        for name in named(".py", rooms=ROOMS)
        for node in ast.walk(tree_of(name))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "print"
    }
    assert printing <= {"app/cli.py"}


def test_only_the_store_knows_sqlite_and_only_the_views_know_viser__law() -> None:
    modules = named(".py", rooms=ROOMS)
    assert {name for name in modules if "sqlite3" in imported(name)} == {"sessions/store.py"}
    assert all(name.startswith("ui/views/") for name in modules if "viser" in imported(name))


def test_errors_are_not_swallowed__law() -> None:
    swallowing = set()
    for name in named(".py", rooms=ROOMS):
        for node in ast.walk(tree_of(name)):
            if isinstance(node, ast.ExceptHandler) and _is_broad(node) and not _raises(node):
                swallowing.add(name)
    assert swallowing <= BROAD


def _is_broad(handler: ast.ExceptHandler) -> bool:
    kinds = [] if handler.type is None else ast.walk(handler.type)
    names = {node.id for node in kinds if isinstance(node, ast.Name)}
    return handler.type is None or bool(names & {"Exception", "BaseException"})


def _raises(handler: ast.ExceptHandler) -> bool:
    return any(isinstance(node, ast.Raise) for node in ast.walk(handler))


def test_every_kind_of_doubt_stands_in_the_table__law() -> None:
    """And each of the table is raised somewhere: `coverage` kinds are made up of two words."""
    named_in = {
        node.value
        for name in named(".py", rooms=("app", "core", "sessions", "ui"))
        if name != "core/doubts.py"
        for node in ast.walk(tree_of(name))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    raised = {
        node.args[0].value
        for name in named(".py", rooms=("app", "core", "sessions", "ui"))
        for node in ast.walk(tree_of(name))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "Doubt"
        and node.args
        and isinstance(node.args[0], ast.Constant)
    }
    assert raised <= set(GRAVITY)
    assert set(GRAVITY) - named_in <= {"ortho-coverage", "dem-coverage"}


def test_tests_say_where_their_expectation_comes_from__law() -> None:
    ending = re.compile(r"__(truth|law|oracle|paper|real)$")
    unsaid = [
        f"{name}: {node.name}"
        for name in named(".py", rooms=("tests",))
        for node in ast.walk(tree_of(name))
        if isinstance(node, ast.FunctionDef)
        and node.name.startswith("test_")
        and not ending.search(node.name)
    ]
    assert not unsaid


def test_no_path_of_a_machine_is_left__law() -> None:
    texts = [
        name
        for name in named(
            ".py", ".js", ".md", ".toml", ".html", ".css", ".sh", "Makefile", "run", ".lock"
        )
        if name != "tests/test_house.py"
    ]
    assert not [name for name in texts if MACHINE_PATHS.search(text_of(name))]


def test_pages_need_no_network__law() -> None:
    pages = named(".html", ".js", ".css", ".svg", rooms=ROOMS)
    assert pages
    assert not [name for name in pages if FROM_NETWORK.search(text_of(name))]


def test_lines_of_pages_are_short__law() -> None:
    pages = {
        name: text_of(name).splitlines() for name in named(".html", ".css", rooms=("app", "ui"))
    }
    assert pages
    assert not [name for name, lines in pages.items() if max(map(len, lines)) > LONGEST_LINE]


def test_every_decision_is_replayed__law() -> None:
    handled = {
        node.cls.id
        for node in ast.walk(ast.parse(Path(replay.__file__).read_text(encoding="utf-8")))
        if isinstance(node, ast.MatchClass) and isinstance(node.cls, ast.Name)
    }
    assert {decision.__name__ for decision in DECISIONS} <= handled


def test_every_verb_and_option_is_in_the_manual__law() -> None:
    told = "\n".join(text_of(name) for name in ["README.md", *manual()])
    verbs = next(a for a in parser()._actions if a.metavar == "VERB").choices
    assert verbs is not None
    for verb, own in verbs.items():
        assert f"gruber {verb}" in text_of("docs/index.md")
        assert f"gruber {verb}" in text_of("README.md")
        # Old forms are understood and not told.
        for action in (one for one in own._actions if one.help != argparse.SUPPRESS):
            for option in action.option_strings:
                assert option in told or option in ("-h", "--help"), (verb, option)


def test_every_stage_is_in_the_manual__law() -> None:
    rows = table_under("docs/index.md", "## The stages")
    assert [row[0].strip("`") for row in rows] == list(stage_names())
    pages = [re.findall(r"\]\((\w+)\.md\)", row[1]) for row in rows]
    assert pages == [[name] for name in stage_names()]


def test_the_manual_is_short__law() -> None:
    """What a user reads, without the signs of tables."""
    words = [word for name in manual() for word in text_of(name).split() if re.search(r"\w", word)]
    assert len(words) <= MOST_WORDS


def test_figures_of_the_demo_stand_in_the_notebook_alone__law() -> None:
    """The manual promised other figures than the demo prints."""
    figure = r"(?:sigma nought|m_p) (?:of |is |= ?)?\d|\d+ (?:of \d+ )?control (?:measure|point)"
    for name in ("README.md", "docs/index.md", "docs/first-block.md"):
        assert not re.search(figure, text_of(name)), name


def test_keys_in_the_manual_are_those_of_the_desk__law() -> None:
    rows = table_under("docs/review-desk.md", "## Keys")
    told = {row[0].strip("`"): row[1].split(":")[0].split(" in the queue")[0] for row in rows}
    assert told == {key: words()[word] for key, word in KEYS}
    reasons = table_under("docs/review-desk.md", "After `N`")
    assert {row[0].strip("`"): row[1] for row in reasons} == {
        number: words()[f"reason.{number}"] for number in "12345"
    }


@pytest.mark.parametrize(
    ("file", "columns"),
    [
        ("control_points.csv", CONTROL_COLUMNS),
        ("check_points.csv", CHECK_COLUMNS),
        ("interior_orientation.csv", INTERIOR_COLUMNS),
        ("exterior_orientation.csv", EXTERIOR_COLUMNS),
        ("tie_points.csv", TIE_COLUMNS),
        ("misfit.csv", MISFIT_COLUMNS),
    ],
)
def test_columns_in_the_manual_are_those_of_the_files__law(file: str, columns: str) -> None:
    rows = table_under("docs/results.md", f"## {file}")
    told = [name for row in rows for name in re.findall(r"`([^`]+)`", row[0])]
    assert [name for name in told if "NAME" not in name] == columns.split(",")


def test_layers_in_the_manual_are_those_of_the_session__law() -> None:
    told = {row[0].strip("`") for row in table_under("docs/results.md", "## session.gpkg")}
    layers = {layer.name for layer in (PHOTOS, FOOTPRINTS, POINTS, MEASUREMENTS)}
    assert told == layers | {"residual_vectors", "decisions"}


def test_paths_named_in_documents_exist__law() -> None:
    named_in = [(page, path) for page in named(".md") for path in _named_paths(page)]
    assert named_in
    assert not [(page, path) for page, path in named_in if not (HOME / path).exists()]


def _named_paths(page: str) -> list[str]:
    """Paths of the project in backticks: what begins with one of its folders or ends as a file."""
    folders = {name.split("/")[0] for name in tracked() if "/" in name}
    words = re.findall(r"`([\w./-]+)`", text_of(page))
    return [word for word in words if "/" in word and word.split("/")[0] in folders]


def test_messages_in_the_manual_are_those_of_the_program__law() -> None:
    said = {text for name in named(".py", rooms=ROOMS) for text in _texts(tree_of(name))}
    said |= set(words().values())
    told = re.findall(r"(?<![*\w])\*([^*|]+)\*(?![*\w])", text_of("docs/troubleshooting.md"))
    pieces = {piece.strip(" .,;:") for message in told for piece in message.split("...")}
    assert not {piece for piece in pieces if not any(piece in text for text in said)}


def _texts(tree: ast.Module) -> list[str]:
    """Every text of a module; the places of an f-string as a mark that no message holds."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append(node.value)
        elif isinstance(node, ast.JoinedStr):
            parts = [v.value if isinstance(v, ast.Constant) else "\0" for v in node.values]
            found.append("".join(map(str, parts)))
    return found


def test_links_between_documents_lead_somewhere__law() -> None:
    lost = []
    for name in named(".md"):
        for target, anchor in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", text_of(name)):
            page = (HOME / name).parent.joinpath(target) if target else HOME / name
            if "://" not in target and not (page.exists() and _has_anchor(page, anchor)):
                lost.append((name, target, anchor))
    assert not lost


def test_what_is_promised_of_security_has_its_tests__law() -> None:
    promises = table_under("SECURITY.md", "## What you may rely on")
    for promise, tests in promises:
        named_tests = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", tests)
        assert named_tests, promise
        for name, function in named_tests:
            assert f"def {function}" in text_of(name), (promise, function)


def _has_anchor(page: Path, anchor: str) -> bool:
    """True when a heading of the page has the anchor, as GitHub makes it."""
    headings = re.findall(r"(?m)^#+ (.+)$", page.read_text(encoding="utf-8")) if anchor else []
    plain = [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings]
    return not anchor or anchor in plain


def test_the_readme_is_found_and_the_version_is_told_in_the_changelog__law() -> None:
    project = text_of("pyproject.toml")
    version = re.search(r'^version = "([^"]+)"', project, re.MULTILINE)
    assert version is not None
    assert f"## [{version[1]}]" in text_of("CHANGELOG.md")
