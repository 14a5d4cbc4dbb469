"""The catalogue: both languages say the same, everything that is said is there, nothing more."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.run import STAGE_NAMES
from core.quality.rules import CLASSES, SENTENCES
from ui.words.catalogue import KEYS, LANGUAGES, preferred_language, words

HOME = Path(__file__).resolve().parents[3]


def sources_of(*rooms: str) -> str:
    files = [path for room in rooms for path in sorted((HOME / room).rglob("*"))]
    code = [path for path in files if path.suffix in (".py", ".js", ".html")]
    return "\n".join(path.read_text(encoding="utf-8") for path in code)


SOURCES = sources_of("app", "ui", "sessions")
PLACE = re.compile(r"\{(\w+)\}")
LITERALS = set(re.findall(r"""["'`]([\w.-]+)["'`]""", SOURCES + sources_of("core")))
TOKENS = set(re.findall(r"\w+", SOURCES))
TEMPLATES = {
    # `quality.${name}` in JavaScript, f"notice.{act}.{name}" in Python.
    "(.+)".join(re.escape(part) for part in re.split(r"\$?\{[^}]*\}", text))
    for text in re.findall(r"""["`]([a-z][\w-]*\.[\w.{}$ ()-]*\{[^"`]*)["`]""", SOURCES)
}


def is_said(key: str) -> bool:
    """True when a key is written out somewhere, or made there of words that occur."""
    if key in LITERALS or (key.endswith(".tip") and is_said(key.removesuffix(".tip"))):
        return True
    for template in TEMPLATES:
        found = re.fullmatch(template, key)
        pieces = [piece for part in (found.groups() if found else ()) for piece in part.split(".")]
        if pieces and all(piece.replace("-", "_") in TOKENS or piece in LITERALS
                          for piece in pieces):  # fmt: skip
            return True
    return False


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
