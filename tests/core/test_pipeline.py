"""The table of contents of the engine, and the first three of its stages on the tiny block."""

from dataclasses import replace

import numpy as np
import pytest

from app.described import described
from app.project import read_project
from core import pipeline
from core.block.registration.orientation import OrientedPhoto, ReferencePoints
from core.block.registration.reference_points import ReferenceFeatures
from core.doubts import Failure
from core.errors import OrientationError, PhotogrammetryError
from core.geometry.exterior import ExteriorOrientation
from core.pipeline import STAGES, orient_scans
from core.progress import Silent
from core.stages import BlockInput, Georeferenced, ScanInput, ScanSet, Tied, Work
from core.whereabouts import (
    block_bounds,
    find_reference_points,
    georeference_photos,
    likelier,
    open_reference,
    random_for,
    search_bounds,
)
from sessions.session import Session

WORK = Work(Silent(), map)


@pytest.fixture(scope="module")
def given(tiny_block) -> BlockInput:
    return described(read_project(tiny_block))


@pytest.fixture(scope="module")
def scans(given) -> ScanSet:
    return orient_scans(given, {}, WORK)


@pytest.fixture(scope="module")
def placed(given, scans) -> Georeferenced:
    return georeference_photos(given, {"scans": scans}, WORK)


def test_every_stage_needs_only_what_comes_before_it__law():
    before: set[str] = set()
    for stage in STAGES:
        assert set(stage.needs) <= before
        before.add(stage.name)
    assert len(before) == len(STAGES)


def test_every_part_of_a_description_enters_a_stage__law(given):
    """A changed reference, scan or setting must not leave a stale product."""
    entered = [part for stage in STAGES for part in stage.inputs(given)]
    # The last adjustment, which decisions enter as well, is a stage of `app.run`.
    for name in BlockInput.__dataclass_fields__:
        if name not in ("name", "adjustment"):
            value = getattr(given, name)
            assert any(part is value for part in entered), name


def test_chance_depends_on_names_alone__law():
    one, same, other = (random_for("block", name).random(4) for name in ("a", "a", "b"))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    assert (random_for("a/b").random(3) == random_for("a", "b").random(3)).all()


def test_scans_are_oriented_to_their_film__truth(tiny, scans):
    assert list(scans.oriented) == tiny.names
    assert not scans.set_aside
    for name, scan in scans.oriented.items():
        true = tiny.truth.photos[name]
        film = np.array([[-60.0, -60.0], [60.0, -60.0], [0.0, 0.0], [55.0, 60.0]])
        found = scan.interior.pixel_from_film(film)
        assert np.abs(found - true.pixels(film)).max() < 0.3


def test_a_scan_that_cannot_be_read_is_set_aside__truth(given, tmp_path):
    broken = tmp_path / "broken.tif"
    broken.write_bytes(b"II*\x00 no more than this")
    mixed = replace(given, scans=(given.scans[0], ScanInput(broken, "archive", 180.0)))
    found = orient_scans(mixed, {}, WORK)
    assert list(found.oriented) == [given.scans[0].path.stem]
    assert list(found.set_aside) == ["broken"]
    assert [doubt.subject for doubt in found.doubts if doubt.kind == "scan-set-aside"] == ["broken"]
    with pytest.raises(PhotogrammetryError, match="broken"):
        orient_scans(replace(given, scans=mixed.scans[1:]), {}, WORK)


def test_photos_lie_where_their_world_files_put_them__truth(tiny, placed):
    """Good ones are five to ten metres off, and know nothing of tilts."""
    for name, photo in placed.block.photos.items():
        away = photo.exterior.centre - tiny.truth.photos[name].exterior.centre
        above = photo.exterior.centre[2] - photo.ground_height_m
        assert np.hypot(*away[:2]) < 12 + above * np.radians(3.0)
        assert not photo.oriented
        assert photo.approximate is photo.exterior
        assert photo.ground_height_m == pytest.approx(tiny.reference.dem.mean_height(), abs=15.0)


def bare(given, scans, folder):
    """The scans in a folder of their own, without the world files beside them."""
    found = {}
    for name, scan in scans.oriented.items():
        path = folder / scan.scan.path.name
        path.symlink_to(scan.scan.path)
        found[name] = replace(scan, scan=replace(scan.scan, path=path))
    return {"scans": replace(scans, oriented=found)}


def test_without_any_source_there_is_nothing_to_begin_with__truth(given, scans, tmp_path):
    nowhere = replace(given, georeference=replace(given.georeference, footprints=None))
    with pytest.raises(OrientationError) as told:
        georeference_photos(nowhere, bare(given, scans, tmp_path), WORK)
    assert "world file" in told.value.remedy


def test_another_source_stands_in_with_a_doubt__truth(given, scans, tmp_path):
    found = georeference_photos(given, bare(given, scans, tmp_path), WORK)
    said = [d.message for d in found.doubts if d.kind == "georeference-missing"]
    assert (
        said
        == ["There is no world file for this scan; it was placed by its footprint instead."] * 6
    )


def test_who_asks_for_no_source_misses_none__truth(given, scans):
    open_ended = replace(given, georeference=replace(given.georeference, source="none"))
    found = georeference_photos(open_ended, {"scans": scans}, WORK)
    assert len(found.block.photos) == 6
    assert not [d for d in found.doubts if d.kind == "georeference-missing"]


def test_the_search_has_room_for_what_the_photos_may_be_off__law(placed):
    inner, outer = block_bounds(placed.block), search_bounds(placed.block)
    sigma = max(p.prior.sigma_centre_m[:2].max() for p in placed.block.photos.values())
    for low, wide in zip(inner[:2], outer[:2], strict=True):
        assert low - wide >= 3 * sigma
    for high, wide in zip(inner[2:], outer[2:], strict=True):
        assert wide - high >= 3 * sigma


def test_reference_points_lie_in_what_is_searched__truth(given, scans, placed):
    made = {"scans": scans, "ties": Tied(placed.block.ties, (), placed)}
    found = find_reference_points(given, made, WORK)
    west, south, east, north = search_bounds(placed.block)
    places = found.points.positions
    assert len(places) > 60
    assert ((places[:, :2] >= [west, south]) & (places[:, :2] <= [east, north])).all()
    assert set(found.sources.values()) == {"junction", "salient"}


def test_a_georeference_that_is_off_leaves_no_trace__truth(given, scans, placed, tiny_run):
    """Ties from poor georeferences are those from good world files, to the last bit."""
    off = np.array([90.0, -70.0, 40.0])
    photos, known = {}, {}
    for number, (name, photo) in enumerate(placed.block.photos.items()):
        exterior = replace(
            photo.exterior,
            centre=photo.exterior.centre + off * (-1) ** number,
            kappa=photo.exterior.kappa + np.radians(2.0),
        )
        photos[name] = replace(photo, exterior=exterior, approximate=exterior)
        known[name] = replace(
            placed.approximations[name], exterior=exterior, hypotheses=(exterior,)
        )
    poor = replace(placed, block=placed.block.with_photos(photos), approximations=known)
    tied = pipeline.tie_photos(given, {"scans": scans, "georeference": poor}, WORK)
    with Session.open(tiny_run.folder, "test") as session:
        good = session.products.latest_value("ties")
    for name, photo in tied.start.block.photos.items():
        other = good.start.block.photos[name].exterior
        np.testing.assert_array_equal(photo.exterior.centre, other.centre)
        assert photo.exterior.kappa == other.kappa
    np.testing.assert_array_equal(tied.ties.pixels, good.ties.pixels)


def test_only_gruber_begins_at_the_rounded_start__law(given, scans, placed, monkeypatch):
    """The published chains look a few dozen metres about a georeference, no further."""
    begun = []

    def assembled(block, *_rest, **_options):
        begun.append(next(iter(block.photos.values())).exterior)
        raise InterruptedError

    monkeypatch.setattr(pipeline, "assemble_published", assembled)
    monkeypatch.setattr(pipeline, "assemble_block", assembled)
    name, photo = next(iter(placed.block.photos.items()))
    moved = replace(photo.exterior, centre=photo.exterior.centre + 100.0)
    photos = {**placed.block.photos, name: photo.with_exterior(moved, False)}
    start = replace(placed, block=placed.block.with_photos(photos))
    made = {
        "scans": scans,
        "georeference": placed,
        "ties": Tied(placed.block.ties, (), start),
        "reference": ReferenceFeatures(ReferencePoints((), np.empty((0, 3)), np.empty((0, 3))), {}),
        "orientation": {},
    }
    for preset in ("gruber", "thesis-2024"):
        with pytest.raises(InterruptedError):
            pipeline.find_control(replace(given, preset=preset), made, WORK)
    assert begun == [moved, photo.exterior]


def test_heights_held_in_memory_are_those_on_disk__law(given, placed):
    bounds = block_bounds(placed.block)
    held, whole = open_reference(given, bounds), open_reference(given)
    rng = np.random.default_rng(0)
    places = rng.uniform(bounds[:2], bounds[2:], (200, 2))
    np.testing.assert_allclose(held.dem.heights(places), whole.dem.heights(places), atol=1e-6)


def test_of_two_results_the_one_less_likely_chance_is_taken__law():
    exterior = ExteriorOrientation(np.zeros(3), 0.0, 0.0, 0.0)

    def stands(nfa):
        return OrientedPhoto(exterior, np.eye(6), (), np.zeros(0, np.int64), (), nfa)

    sure, unsure, fallen, lost = stands(-20.0), stands(-4.0), Failure("fell"), Failure("lost")
    assert likelier(sure, unsure) is likelier(unsure, sure) is sure
    assert likelier(fallen, unsure) is likelier(unsure, fallen) is unsure
    assert likelier(fallen, lost) is lost
