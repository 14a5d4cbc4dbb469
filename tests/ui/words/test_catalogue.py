"""The catalogue: both languages say the same, everything that is said is there, nothing more."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from app.block_schema import TABLES
from app.run import STAGE_NAMES
from core.errors import PhotogrammetryError
from core.formats.exchange_formats import FORMATS
from core.quality.sentences import CLASSES, SENTENCES
from sessions.decisions import NOT_VISIBLE, REASONS
from ui.words.catalogue import KEYS, LANGUAGES, Teller, messages, preferred_language, words

HOME = Path(__file__).resolve().parents[3]
UNTOLD = ("core/literature", "core/synthetic", "app/desk/background.py")
"""Said to who compares methods, or what only a bug brings about: in English alone."""


def sources_of(*rooms: str) -> str:
    files = [path for room in rooms for path in sorted((HOME / room).rglob("*"))]
    code = [path for path in files if path.suffix in (".py", ".js", ".html")]
    return "\n".join(path.read_text(encoding="utf-8") for path in code)


SOURCES = sources_of("app", "ui", "sessions")
PLACE = re.compile(r"\{([\w\[\]]+)[^{}]*\}")
LITERALS = set(re.findall(r"""["'`]([\w.-]+)["'`]""", SOURCES + sources_of("core")))
SPACED = set(re.findall(r'"([a-z]+ [a-z]+)"', SOURCES))
TOKENS = set(re.findall(r"\w+", SOURCES))
TEMPLATES = {
    # `quality.${name}` in JavaScript, f"notice.{act}.{name}" in Python.
    "(.+)".join(re.escape(part) for part in re.split(r"\$?\{[^}]*\}", text))
    for text in re.findall(r"""["`]([a-z][\w-]*\.[\w.{}$ ()-]*\{[^"`]*)["`]""", SOURCES)
} | {
    # `"report.chapter." ~ name` in the page of the report.
    f"{re.escape(text)}(.+)"
    for text in re.findall(r'"([a-z][\w.-]*\.)" ~', SOURCES)
}


def is_said(key: str) -> bool:
    """True when a key is written out somewhere, or made there of words that occur."""
    if key in LITERALS or (key.endswith(".tip") and is_said(key.removesuffix(".tip"))):
        return True
    for template in TEMPLATES:
        found = re.fullmatch(template, key)
        parts = found.groups() if found else ()
        # Names of files have a point of their own.
        pieces = [
            one for part in parts for one in ([part] if part in LITERALS else part.split("."))
        ]
        if pieces and all(_is_written(piece) for piece in pieces):
            return True
    return False


def _is_written(piece: str) -> bool:
    whole = piece.replace("-", "_") in TOKENS or piece in LITERALS
    return whole or piece.replace("-", " ") in SPACED


def sentences() -> Iterator[tuple[str, str, str]]:
    for language in LANGUAGES:
        for key, text in words(language).items():
            yield language, key, text


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_every_language_has_the_same_keys__law(language: str) -> None:
    # A sentence without a translation would be English in a Czech page: words() adds it.
    ours = {f"verdict.{kind}": text for kind, text in SENTENCES.items()}
    ours |= {f"class.{name}": text for name, text in CLASSES.items()}
    assert set(words(language)) - set(ours) == set(words()) - set(ours)
    assert all(words(language)[key] != text for key, text in ours.items())


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_every_language_has_the_same_places_for_values__law(language: str) -> None:
    assert {key: set(PLACE.findall(text)) for key, text in words(language).items()} == {
        key: set(PLACE.findall(text)) for key, text in words().items()
    }


def test_no_text_is_empty_or_carries_markup__law() -> None:
    for language, key, text in sentences():
        assert text.strip() == text, (language, key)
        assert text, (language, key)
        assert "<" not in text, (language, key)


def test_a_count_and_what_it_is_of_are_both_figures__law() -> None:
    """It said "9 of nine parts"."""
    mixed = re.compile(r"\} (of|z|ze) (nine|devíti)")
    assert not [(language, key) for language, key, text in sentences() if mixed.search(text)]


def test_every_text_is_used__law() -> None:
    unused = [key for key in words() if not is_said(key) and key[8:] not in SENTENCES]
    assert not unused


def test_an_unused_text_would_be_noticed__truth() -> None:
    assert is_said("act.accept")
    assert is_said("quality.residuals.long")
    assert not is_said("act.somersault")
    assert not is_said("quality.somersault")
    assert not is_said("somersault.tip")


def test_every_key_that_is_asked_for_has_a_text__law() -> None:
    asked = set(re.findall(r'\b(?:word|Notice|DoubtReason)\(\s*"([\w.-]+)"', SOURCES))
    asked |= set(re.findall(r'data-(?:word|label)="([\w.-]+)"', SOURCES))
    assert len(asked) > 100
    assert asked <= set(words()), asked - set(words())
    assert {name for _, name in KEYS} <= set(words())


def test_every_stage_of_a_run_has_a_name__law() -> None:
    named = {key for key in words() if key.startswith("stage.")}
    assert named == {f"stage.{name}" for name in STAGE_NAMES}


def test_words_of_another_language_are_refused__truth() -> None:
    with pytest.raises(AssertionError, match="no texts in tlh"):
        words("tlh")


@pytest.mark.parametrize(
    ("accepted", "language"),
    [
        ("", "en"),
        ("cs-CZ,cs;q=0.9,en;q=0.8", "cs"),
        ("en-GB,en;q=0.9,cs;q=0.8", "en"),
        ("de;q=1.0, cs;q=0.3, en;q=0.7", "en"),
        ("sk, CS; q=0.5", "cs"),
        ("fr,de", "en"),
        ("cs;q=nonsense", "en"),
        ("cs;q=0", "en"),
    ],
)
def test_the_language_is_what_the_browser_likes_best__truth(accepted: str, language: str) -> None:
    assert preferred_language(accepted) == language


def templates_said() -> dict[str, str]:
    """Every sentence that `say` is given, with the file; a name stands for what it was set to."""
    found: dict[str, str] = {}
    for path in code_of("app", "core", "sessions", "ui"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        named: dict[str, list[ast.expr]] = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                named.setdefault(node.targets[0].id, []).append(node.value)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "say":
                found |= dict.fromkeys(texts_in(node.args[0], named), path.name)
    return found


def texts_in(node: ast.expr, named: dict[str, list[ast.expr]]) -> Iterator[str]:
    """The plain texts an expression may be; nothing that is built of pieces is one."""
    match node:
        case ast.Constant(value=str() as text):
            yield text
        case ast.IfExp():
            yield from texts_in(node.body, named)
            yield from texts_in(node.orelse, named)
        case ast.Name() if node.id in named:
            for value in named[node.id]:
                yield from texts_in(value, named)
        case ast.Subscript():  # a table of the rules, told by key
            return
        case _:
            raise AssertionError(f"a sentence is built of pieces: {ast.unparse(node)}")


def code_of(*rooms: str) -> Iterator[Path]:
    for room in rooms:
        yield from sorted((HOME / room).rglob("*.py"))


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_what_the_engine_says_is_known_in_every_language__law(language: str) -> None:
    told, known = templates_said(), messages(language)
    told |= {
        str(one.value): at
        for at, one in engine_texts()
        if isinstance(one, ast.Constant) and not at.startswith(UNTOLD)
    }
    assert len(told) > 150
    assert not {text: file for text, file in told.items() if text not in known}
    # Titles, rules and verdicts are told as they stand.
    written = {
        node.value
        for path in code_of("app", "core", "sessions", "ui")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant)
    }
    assert not [text for text in known if text not in written | set(told)]
    places = {text: (PLACE.findall(text), PLACE.findall(known[text])) for text in told}
    assert not [text for text, (ours, theirs) in places.items() if set(ours) != set(theirs)]


MESSAGES = {
    "Doubt": (2,), "Failure": (0,), "refused": (0, 1), "Measurement": (7,), "replace": (),
}  # fmt: skip
"""Which arguments are told; those of an error are its cause and its remedy."""


class Module:
    """What the names and functions of one module may be."""

    def __init__(self, tree: ast.Module) -> None:
        nodes = [node for node in ast.walk(tree) if not isinstance(node, ast.expr_context)]
        self.given = [
            (target, node.value)
            for node in nodes
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value
            for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        ]
        self.returned = {
            node.name: [one.value for one in ast.walk(node) if isinstance(one, ast.Return)]
            for node in nodes
            if isinstance(node, ast.FunctionDef)
        }

    def texts(self, told: ast.expr) -> Iterator[ast.expr]:
        """The texts an expression may be."""
        todo, met = [(told, -1)], set[tuple[int, int]]()
        while todo:
            node, place = todo.pop()
            if (id(node), place) in met:
                continue
            met.add((id(node), place))
            if place < 0 and isinstance(node, ast.Constant | ast.JoinedStr | ast.BinOp):
                if getattr(node, "value", node):
                    yield node
            else:
                todo += self.parts(node, place)

    def parts(self, node: ast.expr, place: int) -> list[tuple[ast.expr, int]]:
        """What an expression may be instead, itself or one place of a pair."""
        match node:
            case ast.Tuple(elts=elts):
                return [(elts[place], -1)] if 0 <= place < len(elts) else []
            case ast.IfExp(body=body, orelse=orelse):
                return [(body, place), (orelse, place)]
            case ast.BoolOp(values=values) | ast.Dict(values=values):
                return [(one, place) for one in values]
            case ast.Subscript(value=table):
                return [(table, place)]
            case ast.Call(func=ast.Name(id=name)):
                return [(one, place) for one in self.returned.get(name, ()) if one]
            case ast.Name(id=name):
                return [*self.named(name, place)]
            case _:
                return []

    def named(self, name: str, place: int) -> Iterator[tuple[ast.expr, int]]:
        """What a name was set to, by itself or as one of a pair."""
        for target, value in self.given:
            if isinstance(target, ast.Name) and target.id == name:
                yield value, place
            elif isinstance(target, ast.Tuple) and place < 0:
                names = [getattr(one, "id", "") for one in target.elts]
                if name in names:
                    yield value, names.index(name)


@cache
def engine_texts() -> tuple[tuple[str, ast.expr], ...]:
    """Where a doubt, a failure, a measurement or an error is made: what is told."""
    kinds = {kind.__name__ for kind in PhotogrammetryError.__subclasses__()}
    found: list[tuple[str, ast.expr]] = []
    for path in code_of("app", "core", "sessions", "ui"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        module = Module(tree)
        for node in ast.walk(tree):
            func = getattr(node, "func", None)
            name = getattr(func, "id", "") or getattr(func, "attr", "")
            if isinstance(node, ast.Call) and name in MESSAGES.keys() | kinds:
                told = [node.args[n] for n in MESSAGES.get(name, (1, 2)) if n < len(node.args)]
                told += [one.value for one in node.keywords if one.arg in ("message", "reason")]
                for one in (text for argument in told for text in module.texts(argument)):
                    found.append((f"{path.relative_to(HOME)}:{one.lineno}", one))
    return tuple(found)


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_doubts_failures_and_errors_are_known_in_every_language__law(language: str) -> None:
    found = engine_texts()
    assert len(found) > 200
    # `say` keeps template and figures: an f-string would be English for ever.
    built = [where for where, one in found if isinstance(one, ast.JoinedStr | ast.BinOp)]
    assert [where for where in built if not where.startswith(UNTOLD)] == []
    plain = {one.value: where for where, one in found if isinstance(one, ast.Constant)}
    unknown = {text: where for text, where in plain.items() if text not in messages(language)}
    assert [text for text, where in unknown.items() if not where.startswith(UNTOLD)] == []


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_reasons_of_a_rejection_are_known_in_every_language__law(language: str) -> None:
    assert {*REASONS, NOT_VISIBLE} <= set(messages(language))


def test_no_sentence_of_the_catalogue_is_built_of_pieces__law() -> None:
    """Neither `tell(...) + tell(...)` nor a text of the catalogue inside an f-string."""
    built = [
        f"{path.name}:{node.lineno}"
        for path in code_of("app", "ui")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.BinOp | ast.JoinedStr)
        for inside in ast.walk(node)
        if isinstance(inside, ast.Call) and getattr(inside.func, "id", "") in ("tell", "say")
    ]
    assert not built


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_formats_of_other_programs_are_told_in_every_language__law(language: str) -> None:
    """But those that are nothing but names, as QGIS or COLMAP."""
    known, tell = messages(language), Teller(language)
    titles = [form.title for form in FORMATS.values()]
    english = [title for title in titles if re.search(r"(?<![\w.])[a-z]+(?![\w.])", title)]
    assert len(english) > 15
    assert all(tell.again(title) != title for title in english)
    assert {"degrees", "radians"} <= set(known)


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_choice_of_the_form_has_a_text__law(language: str) -> None:
    choices = {
        choice
        for table in TABLES.values()
        for key in table
        if key.asked != "file"
        for choice in key.choices
        if choice and not choice.isdigit()
    }
    assert len(choices) > 5
    assert {f"choice.{choice}" for choice in choices} <= set(words(language))


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_texts_of_a_language_call_no_key_by_its_english_name__truth(language: str) -> None:
    assert words(language)["key.Space"] != "Space"
    assert not [key for key, text in words(language).items() if re.search(r"\bSpace\b", text)]


TIMES = [("2026-11-05T03:12:07.250+00:00", "2026-11-05 03:12", "5.\u00a011.\u00a02026 03:12"),
         ("2026-11-05 03:12 UTC", "2026-11-05 03:12 UTC", "5.\u00a011.\u00a02026 03:12 UTC"),
         ("1938-05-16", "1938-05-16", "1938-05-16")]  # fmt: skip


@pytest.mark.parametrize(("kept", "english", "czech"), TIMES)
def test_a_time_is_written_as_the_language_does__truth(kept: str, english: str, czech: str) -> None:
    assert [Teller(language).moment(kept) for language in ("en", "cs")] == [english, czech]
    told = Teller("cs")("report.written", at=kept, operator="ada", version="1")
    assert czech in told


def test_one_word_for_one_thing_in_czech__truth() -> None:
    """Two filters were called alike, and sigma nought had two names."""
    czech = words("cs")
    assert len({czech[f"state.{name}"] for name in ("open", "auto")} | {czech["role.new"]}) == 3
    both = {**czech, **messages("cs")}.values()
    assert not [text for text in both if re.search(r"[Jj]ednotkov\w+ odchylk", text)]
    assert not [text for text in both if "orld file" in text]
