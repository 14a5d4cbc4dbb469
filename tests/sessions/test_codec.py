"""Bytes and back."""

import json
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from core.block import Block, Peak
from core.doubts import Doubt
from core.said import Said, say
from sessions.codec import REGISTERED, CodecError, canonical, decode, encode


def same(one: Any, other: Any) -> bool:
    """Equal in value, type and shape, NaN included."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return (
            one.dtype == other.dtype
            and one.shape == other.shape
            and one.tobytes() == other.tobytes()
        )
    if isinstance(one, float):
        return one == other or (one != one and other != other)
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    return one == other


arrays = hnp.arrays(
    st.sampled_from([np.float64, np.float32, np.int64, np.int32, np.uint8, np.bool_]),
    hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
)
words = st.text(max_size=8)
leaves = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    words,
    arrays,
    st.builds(Peak, st.floats(), st.floats(), st.floats(), st.floats(), words),
    st.builds(Path, st.just("scans/a.tif")),
)
keys = st.one_of(words, st.tuples(words, words), st.integers(), st.just("@array"))
values = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.lists(inner, max_size=3).map(tuple),
        st.dictionaries(keys, inner, max_size=3),
        st.builds(Doubt, words, words, words, st.floats(), st.dictionaries(words, inner)),
    ),
    max_leaves=12,
)


@given(values)
def test_decoded_is_what_was_encoded__law(value: Any) -> None:
    assert same(decode(encode(value)), value)


@given(st.dictionaries(keys, st.integers(), max_size=5), st.randoms())
def test_canonical_form_does_not_know_the_order_of_a_mapping__law(value: Any, random: Any) -> None:
    items = list(value.items())
    random.shuffle(items)
    assert canonical(value, str) == canonical(dict(items), str)


def test_a_whole_block_and_its_report_come_back__truth(block: Block, report_of: Any) -> None:
    report = report_of(block)
    again = decode(encode(report))
    assert same(again, report)
    assert not again.tie_positions.flags.writeable
    assert again.block.photos["A"].interior.names == ("1", "2")


def test_a_geometry_comes_back__truth() -> None:
    polygon = shapely.box(0, 0, 0.1, 1 / 3)
    assert shapely.equals_identical(decode(encode(polygon)), polygon)


def test_a_big_endian_array_comes_back_in_the_machines_order__truth() -> None:
    again = decode(encode(np.array([1.5, 2.5], dtype=">f8")))
    assert again.dtype == np.float64
    assert list(again) == [1.5, 2.5]


def test_a_field_that_was_added_later_takes_its_default__truth() -> None:
    data = json.loads(encode(Doubt("datum", "subject", "message", 0.2)))
    del data["value"]["gravity"]
    assert decode(json.dumps(data).encode()).gravity == 0.9


@dataclass(frozen=True)
class Unregistered:
    size: int


def test_what_cannot_be_stored_is_refused_by_name__truth() -> None:
    with pytest.raises(CodecError, match="Unregistered is not in"):
        encode(Unregistered(3))
    with pytest.raises(CodecError, match="a complex cannot be stored"):
        encode(1j)
    assert b"Unregistered" in canonical(Unregistered(3), str)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a stored value"),
        (b"[1]", "no version"),
        (b"\xff\xfe", "not a stored value"),
        (b'{"gruber":2,"value":1}', "version 2 of the encoding; this Gruber knows version 1"),
        (b'{"gruber":1,"value":{"@":"Later"}}', "unknown type Later"),
        (b'{"gruber":1,"value":{"@later":1}}', "unknown kind @later"),
        (b'{"gruber":1,"value":{"@":"Peak","column":1}}', "other fields in this version: operator"),
        (b'{"gruber":1,"value":{"@array":"<f8","shape":[3],"data":"AAAA"}}', "damaged @array"),
    ],
)
def test_bytes_of_another_kind_or_version_are_refused_in_words__truth(
    data: bytes, message: str
) -> None:
    with pytest.raises(CodecError, match=message):
        decode(data)


def test_every_registered_type_is_a_frozen_dataclass__law() -> None:
    for kind in REGISTERED:
        assert is_dataclass(kind)
        assert kind.__dataclass_params__.frozen


def test_a_sentence_keeps_its_figures__law():
    why = say("{count:# mark|# marks} of {all}", count=2, all=8)
    doubt = Doubt("fiducials-few", "513", say("Lost: {why}", why=why))
    read = decode(encode(doubt))
    assert read == doubt
    assert isinstance(read.message, Said)
    assert read.message.values["why"].values == {"count": 2, "all": 8}
    # What it says is what counts for a digest, not how.
    assert canonical(why, str) == canonical(str(why), str)
