"""Single keys of a `block.toml` changed: what else stands there stays as it was."""

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from app.block_writing import toml_value, with_values
from app.new_block import UNKNOWN_DISTANCE

TEXT = """\
# my block
[block]
name = "a # b"  # kept
crs = "EPSG:5514"

[camera.film]  # the wide one
# FILL IN: principal distance from the camera certificate, millimetres, such as 211.59
# principal_distance_mm =
frame_mm = [
    180.0,  # width
    180.0,
]  # guessed

[scans]
files = "scans/*.tif"

[[scans.override]]
file = "x.tif"
exclude = true
"""


def test_what_asks_for_a_value_goes_when_it_is_filled__law():
    """It stood in two lines, and stayed above what was filled."""
    asked = "\n".join(("[camera.film]", *UNKNOWN_DISTANCE, "frame_mm = [180.0, 180.0]", ""))
    filled = with_values(asked, {("camera.film", "principal_distance_mm"): 211.59})
    assert filled == ("[camera.film]\nprincipal_distance_mm = 211.59\nframe_mm = [180.0, 180.0]\n")


def test_comments_and_order_stay__truth():
    changes = {
        ("block", "name"): 'new "name"',
        ("camera.film", "principal_distance_mm"): 211.59,
        ("camera.film", "frame_mm"): [230.0, 230.0],
        ("camera.film", "fiducials_mm"): {"1": [-84.5, 0.3], "a b": [84.5, -0.2]},
        ("scans", "scan_pixel_um"): 15.0,
        ("reference", "dem"): "dem.tif",
        ("block", "crs"): None,
    }
    assert (
        with_values(TEXT, changes)
        == """\
# my block
[block]
name = "new \\"name\\""  # kept

[camera.film]  # the wide one
principal_distance_mm = 211.59
frame_mm = [230.0, 230.0]  # guessed
fiducials_mm = {1 = [-84.5, 0.3], "a b" = [84.5, -0.2]}

[scans]
files = "scans/*.tif"
scan_pixel_um = 15.0

[[scans.override]]
file = "x.tif"
exclude = true

[reference]
dem = "dem.tif"
"""
    )


def test_nothing_changed_is_the_same_text__law():
    assert with_values(TEXT, {("ortho", "gsd_m"): None}) == TEXT


def test_a_file_written_otherwise_is_changed_as_well__law():
    for text in ('block = { name = "a" }  # short\n', 'block.name = "a"  # short\n'):
        changed = with_values(text, {("block", "name"): "b"})
        assert tomllib.loads(changed) == {"block": {"name": "b"}}
        assert changed.endswith("# short\n")


WORDS = st.text(st.characters(exclude_categories=("Cs",)), max_size=12)
VALUES = st.one_of(
    WORDS, st.booleans(), st.integers(-(10**9), 10**9),
    st.floats(allow_nan=False, allow_infinity=False), st.lists(WORDS, max_size=3),
    st.dictionaries(WORDS, st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=2), max_size=3),
)  # fmt: skip


@given(VALUES)
def test_every_value_is_read_back_as_it_was__law(value):
    text = with_values(TEXT, {("block", "name"): value})
    assert tomllib.loads(text)["block"]["name"] == value
    assert tomllib.loads(f"value = {toml_value(value)}")["value"] == value
