"""The ledger of numbers: every numeric setting of core beside its reason.

`python -m tests.ledger` writes docs/measurements/numbers.md; `python -m tests.ledger ROOM ...`
prints what still lacks a reason there. tests/test_ledger.py fails on a setting without one.

A setting is
* a module constant that holds a number, whatever its value (a tuple or table counts once); what is
  computed from other constants and trivial numbers alone is none,
* the default of a field in a class called `...Options`, `...Limits` or `...Priors`,
* any other number in an expression or default, once for each value and statement, unless trivial.

Trivial are 0, 1, 2, 3, 4, 10, 100, 1000, 0.5, 90, 180, 360, the same below zero, and the ranges of
whole numbers of 8 and 16 bits (255, 256, 65535, 65536); also indices, exponents, shapes, axes and
digits to print. Members of an `Enum`, versions of stages and names that end in `VERSION` are no
settings.

The reason is a comment, behind the statement, inside it, or on the lines right above it:
`# source: ...`, `# measured: ...` or `# design: ...`.
"""

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

HOME = Path(__file__).resolve().parents[1]
PAGE = HOME / "docs" / "measurements" / "numbers.md"
KINDS = ("source", "measured", "design")
TRIVIAL = {0, 1, 2, 3, 4, 10, 100, 1000, 0.5, 90, 180, 360, 255, 256, 65535, 65536}
OPTION_CLASSES = ("Options", "Limits", "Priors")
SHAPES = {
    *("zeros", "ones", "empty", "full", "reshape", "eye", "identity", "range", "tile", "repeat"),
    *("broadcast_to", "hsplit", "vsplit", "array_split", "expand_dims", "moveaxis", "swapaxes"),
    *("transpose", "round", "ljust", "rjust", "zfill", "islice"),
}
"""Functions whose arguments are shapes, counts or digits."""
SHAPE_KEYWORDS = {
    "axis",
    "axes",
    "shape",
    "ndmin",
    "digits",
    "ndigits",
    "decimals",
    "indent",
    "version",
}
"""Keyword arguments that are shapes, counts, digits or the version of a stage."""
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
EXEMPT = {"synthetic"}
"""Counted, not listed: a model world is its numbers."""


@dataclass(frozen=True)
class Setting:
    """One numeric setting and why it has its value."""

    file: str
    """Module, from the checkout."""
    line: int
    """Line of its statement."""
    name: str
    """Name of the constant or field, or the function that holds the number."""
    value: str
    """As written."""
    kind: str
    """One of KINDS; empty where no reason is given."""
    reason: str
    """What the comment says behind its kind."""

    @property
    def room(self) -> str:
        """Folder or module of core."""
        return Path(self.file).parts[1].removesuffix(".py")


@cache
def all_settings() -> list[Setting]:
    """Every numeric setting of core, by file and line."""
    modules = sorted((HOME / "core").rglob("*.py"))
    return [setting for module in modules for setting in settings_of(module)]


def settings_of(module: Path) -> list[Setting]:
    """Settings of one module in the order of its lines."""
    return settings_in(module.read_text(encoding="utf-8"), str(module.relative_to(HOME)))


def settings_in(text: str, file: str) -> list[Setting]:
    """Settings of a module's text."""
    comments = _comments(text)
    rows: dict[tuple[int, str, str], Setting] = {}
    for statement, name, value in _numbers(ast.parse(text)):
        kind, reason = _reason(statement, comments)
        key = (statement.lineno, name, value)
        rows[key] = Setting(file, statement.lineno, name, value, kind, reason)
    return sorted(rows.values(), key=lambda setting: setting.line)


def _numbers(tree: ast.Module) -> Iterator[tuple[ast.stmt, str, str]]:
    """Statement, name and value of each setting."""

    def look(node: ast.AST, path: list[ast.AST]) -> Iterator[tuple[ast.stmt, str, str]]:
        within = [*path, node]
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield from _setting(within)
        for child in ast.iter_child_nodes(node):
            yield from look(child, within)

    yield from look(tree, [])


def _setting(path: list[ast.AST]) -> Iterator[tuple[ast.stmt, str, str]]:
    """What one number sets, by all that stands around it; nothing if it sets nothing."""
    if any(_is_harmless(outer, inner) for outer, inner in pairwise(path)):
        return
    node = path[-1]
    assert isinstance(node, ast.Constant)
    statement = [n for n in path if isinstance(n, ast.stmt)][-1]
    owners = [n for n in path if isinstance(n, (ast.ClassDef, *FUNCTIONS))]
    scope = ".".join(n.name for n in owners if not isinstance(n, ast.Lambda))
    if isinstance(statement, (ast.Assign, ast.AnnAssign)) and not _in_function(statement, path):
        target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
        owner = owners[0] if owners and isinstance(owners[0], ast.ClassDef) else None
        name = ast.unparse(target)
        if name.endswith(("VERSION", "VERSIONS")) or (owner and _is_enum(owner)):
            return
        if statement.value is None:
            return
        derived = any(isinstance(n, ast.Name) and n.id.isupper() for n in ast.walk(statement.value))
        counts = not derived if owner is None else owner.name.endswith(OPTION_CLASSES)
        if counts or not _is_trivial(node):
            yield statement, f"{scope}.{name}" if scope else name, ast.unparse(statement.value)
    elif not _is_trivial(node):
        sign = (
            "-" if isinstance(path[-2], ast.UnaryOp) and isinstance(path[-2].op, ast.USub) else ""
        )
        yield statement, scope, f"{sign}{node.value}"


def _in_function(statement: ast.stmt, path: list[ast.AST]) -> bool:
    return any(isinstance(node, FUNCTIONS) for node in path[: path.index(statement)])


def _is_enum(owner: ast.ClassDef) -> bool:
    return any("Enum" in ast.unparse(base) or "Flag" in ast.unparse(base) for base in owner.bases)


def _is_trivial(node: ast.Constant) -> bool:
    return node.value in TRIVIAL


def _is_harmless(outer: ast.AST, inner: ast.AST) -> bool:
    """Whether all that stands in `inner` is index, exponent, shape or format because of `outer`."""
    match outer:
        case ast.Subscript():
            return inner is outer.slice
        case ast.BinOp(op=ast.Pow()):
            return inner is outer.right
        case ast.FormattedValue():
            return inner is outer.format_spec
        case ast.keyword():
            return outer.arg in SHAPE_KEYWORDS
        case ast.Call():
            called = outer.func
            name = called.attr if isinstance(called, ast.Attribute) else ast.unparse(called)
            shaped = outer.args if name in ("reshape", "range", "transpose") else outer.args[:1]
            if name in ("round", "tile", "repeat", "broadcast_to", "islice", "array_split"):
                shaped = outer.args[1:]
            return name in SHAPES and inner in shaped
        case _:
            return False


@dataclass(frozen=True)
class _Comment:
    text: str
    alone: bool
    """Whether nothing else stands on its line."""


def _comments(text: str) -> dict[int, _Comment]:
    """Comments by line, without their mark."""
    found = {}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            words = token.string.split("# fmt:")[0].split("# noqa")[0]
            found[token.start[0]] = _Comment(
                words.lstrip("# ").rstrip(), not token.line[: token.start[1]].strip()
            )
    return found


def _reason(statement: ast.stmt, comments: dict[int, _Comment]) -> tuple[str, str]:
    """Kind and words of the reason beside a statement; empty if there is none."""
    first, last = _lines_of(statement)
    above = first
    while (comment := comments.get(above - 1)) and comment.alone:
        above -= 1
    kind, words = "", []
    for line in range(above, last + 1):
        text = comments[line].text if line in comments else ""
        begun = re.match(rf"({'|'.join(KINDS)}):\s*(.*)", text)
        if begun:
            kind = kind or begun[1]
            words.append(begun[2])
        elif text and kind and line < first:
            words.append(text)
    return kind, " ".join(words)


def _lines_of(statement: ast.stmt) -> tuple[int, int]:
    """First and last line of a statement; of one that has a body, only what stands before it."""
    decorators = getattr(statement, "decorator_list", [])
    first = min([statement.lineno, *(node.lineno for node in decorators)])
    body = getattr(statement, "body", None) or getattr(statement, "cases", None)
    if body is None:
        return first, statement.end_lineno or first
    start = getattr(body[0], "lineno", None) or body[0].pattern.lineno
    return first, max(first, start - 1)


def table(settings: list[Setting]) -> str:
    """The ledger as a page."""
    rooms = sorted({setting.room for setting in settings})
    kinds = Counter((setting.room, setting.kind or "none") for setting in settings)
    columns = (*KINDS, "none")
    head = "| room | " + " | ".join(columns) + " | all |\n|---|" + "---|" * (len(columns) + 1)
    counts = [[kinds[room, kind] for kind in columns] for room in rooms]
    lines = [
        f"| {room} | " + " | ".join(map(str, [*row, sum(row)])) + " |"
        for room, row in zip(rooms, counts, strict=True)
    ]
    sums = [sum(column) for column in zip(*counts, strict=True)]
    lines.append("| all | " + " | ".join(map(str, [*sums, sum(sums)])) + " |")
    rows = [
        "| " + " | ".join(_cell(text) for text in cells) + " |"
        for cells in (
            (s.file, s.name, s.value, s.kind, s.reason) for s in settings if s.room not in EXEMPT
        )
    ]
    return "\n".join(
        [
            "# Numbers and their reasons",
            "",
            "Written by `python -m tests.ledger`; `tests/ledger.py` says what counts as a setting.",
            "",
            head,
            *lines,
            "",
            "| file | name | value | kind | reason |",
            "|---|---|---|---|---|",
            *rows,
            "",
        ]
    )


def _cell(text: str) -> str:
    short = " ".join(text.split())
    return (short if len(short) <= 160 else short[:157] + "...").replace("|", "\\|")


def main(rooms: list[str]) -> None:
    """Write the page, or print what lacks a reason in some rooms."""
    settings = all_settings()
    if not rooms:
        PAGE.parent.mkdir(parents=True, exist_ok=True)
        PAGE.write_text(table(settings), encoding="utf-8")
    for setting in settings:
        if setting.room in rooms and not setting.kind:
            place = f"{setting.file}:{setting.line}"
            sys.stdout.write(f"{place}: {setting.name} = {' '.join(setting.value.split())[:80]}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
