"""Names by a pattern."""

from hypothesis import given
from hypothesis import strategies as st

from sessions.names import next_name


def test_names_count_on__truth():
    assert next_name("N###", []) == "N001"
    assert next_name("N###", ["N001", "N007", "N7x", "P9"]) == "N008"
    assert next_name("H#", ["H9", "H10"]) == "H11"
    assert next_name("roof-##-a", ["roof-99-a"]) == "roof-100-a"
    assert next_name("P", ["P3"]) == "P4"


@given(st.text("N#a1", max_size=6), st.lists(st.text("Na12", max_size=5)))
def test_a_name_is_never_given_twice__law(pattern, taken):
    given_names = list(taken)
    for _ in range(3):
        name = next_name(pattern, given_names)
        assert name not in given_names
        given_names.append(name)
