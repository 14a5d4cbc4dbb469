"""A sentence with figures: told in English, kept for other languages."""

import copy
import pickle

import pytest

from core.said import Said, say
from ui.words.catalogue import Teller, czech_form

TOLD = say("{count:# mark|# marks} in {scan}: {why}", count=2, scan="7", why=say("{m:.1f} m", m=-1))


def test_a_sentence_reads_as_english_and_keeps_its_figures__truth():
    assert TOLD == "2 marks in 7: \u22121.0 m"
    assert TOLD.template == "{count:# mark|# marks} in {scan}: {why}"
    assert say("{n:,} px", n=12345) == "12\u202f345 px"
    assert say("{names}", names=["a", "b"]) == "a, b"


@pytest.mark.parametrize("again", [copy.deepcopy, lambda s: pickle.loads(pickle.dumps(s))])
def test_a_copy_keeps_its_figures__law(again):
    copied = again(TOLD)
    assert isinstance(copied, Said)
    assert (copied.template, copied.values, copied) == (TOLD.template, TOLD.values, TOLD)


@pytest.mark.parametrize(
    ("number", "form"), [(0, 2), (1, 0), (2, 1), (4, 1), (5, 2), (11, 2), (22, 2), (101, 2)]
)
def test_czech_has_three_forms_of_a_noun__truth(number, form):
    assert czech_form(number) == form


@pytest.mark.parametrize(
    ("count", "told"),
    [(1, "1 základna"), (3, "3 základny"), (5, "5 základen"), ("2.5", "2,5 základny")],
)
def test_a_fraction_is_counted_with_a_form_of_its_own__truth(count, told):
    assert Teller("cs")("rules.limit.bases", most=count) == told


def test_numbers_are_written_as_the_language_writes_them__truth():
    czech = Teller("cs")
    assert czech.number(-1234.5, ",.1f") == "\u22121\u202f234,5"
    assert czech("rules.value.against", metres="18.2", worst="P1") == "18,2 m: P1"
    assert czech("rules.value.against", metres="1", worst="film_1.2") == "1 m: film_1.2"
    assert czech.number(None) == "\u2013"
