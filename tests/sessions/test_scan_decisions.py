"""Masks and placings by hand, replayed over a block."""

from dataclasses import replace

import numpy as np
import pytest

from core.block import Block
from core.georeference.archive import Georeference, Pairs
from core.matching.reference import ReferenceFiles
from core.raster.scan_file import ScanFile
from core.results import BlockInput
from core.scans.film_area import FilmArea
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanInput, ScanSet
from sessions.codec import encode, from_json, to_json
from sessions.decisions import Accept, Decision, DrawMask, PlacePhoto, Recorded, Withdraw
from sessions.replay import replay
from sessions.scan_decisions import judged_scans, with_clicks
from tests.sessions.conftest import CAMERA


def number(*items: Decision) -> list[Recorded]:
    return [Recorded(n + 1, "", "ada", item) for n, item in enumerate(items)]


def about(block: Block, key: tuple[str, str], half: float = 30.0) -> DrawMask:
    """A square about a measurement."""
    item = block.measurements[key]
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    outline = tuple((item.column + half * x, item.row + half * y) for x, y in corners)
    return DrawMask(key[1], outline, 0.0, hides=True)


def test_what_the_program_found_inside_is_left_out_and_undo_brings_it_back__law(
    block: Block,
) -> None:
    mask = about(block, ("P1", "A"))
    masked = replay(block, number(mask)).block
    assert masked.measurements["P1", "A"].status == "unused"
    assert "masked by hand" in masked.measurements["P1", "A"].reason
    others = masked.measurements.keys() - {("P1", "A")}
    assert all(masked.measurements[key] is block.measurements[key] for key in others)
    assert masked.photos["A"].mask
    assert not masked.photos["B"].mask
    undone = replay(block, number(mask, Withdraw(1))).block
    assert encode(undone) == encode(block)


def test_what_an_operator_accepted_inside_stays__law(block: Block) -> None:
    item = block.measurements["P1", "A"]
    accepted = Accept("P1", "A", item.column, item.row)
    for order in ((accepted, about(block, ("P1", "A"))), (about(block, ("P1", "A")), accepted)):
        assert replay(block, number(*order)).block.measurements["P1", "A"].status == "accepted"


def test_rays_of_ties_inside_are_left_out__law(block: Block) -> None:
    corner = ((0.0, 0.0), (200.0, 0.0), (200.0, 200.0), (0.0, 200.0))
    masked = replay(block, number(DrawMask("A", corner, 0.0, hides=True))).block
    assert masked.ties.photo.tolist() == [1, 1]
    assert masked.ties.point.tolist() == [0, 1]


def test_an_eraser_frees_what_a_mask_hid__law(block: Block) -> None:
    mask, item = about(block, ("P1", "A")), block.measurements["P1", "A"]
    rub = DrawMask("A", ((item.column, item.row),), 20.0, hides=False)
    assert replay(block, number(mask, rub)).block.measurements["P1", "A"].status == "auto"


def test_a_mask_of_a_camera_holds_for_all_its_scans__law(block: Block) -> None:
    item = block.measurements["P1", "B"]
    film = block.photos["B"].interior.film_from_pixel(item.pixel)[0]
    stroke = DrawMask("wide", ((float(film[0]), float(film[1])),), 0.6, hides=True, on_film=True)
    masked = replay(block, number(stroke)).block
    assert masked.measurements["P1", "B"].status == "unused"
    for photo in masked.photos.values():
        pixel = photo.interior.pixel_from_film(film[None])
        assert photo.mask.hides(pixel).all()
    unknown = replay(block, number(DrawMask("narrow", stroke.outline, 0.6, True, True)))
    assert [one.decision_id for one in unknown.unmatched] == [1]


@pytest.mark.parametrize(
    "decision",
    [
        DrawMask("A", ((1.0, 2.0), (3.5, 4.0), (0.0, 9.0)), 2.5, hides=False, on_film=True),
        PlacePhoto("A", ((1.0, 2.0, 3.0, 4.0), (5.0, 6.0, 7.0, 8.0))),
    ],
)
def test_both_are_kept_as_they_were_decided__law(decision: Decision) -> None:
    assert from_json(to_json(decision)) == decision


def test_the_next_run_is_given_scans_with_their_masks__law(block: Block) -> None:
    photo = block.photos["A"]
    corners = np.array([[0.0, 0.0], [12000.0, 0.0], [12000.0, 12000.0], [0.0, 12000.0]])
    scan = ScanOrientation(
        "A", ScanFile(photo.scan, photo.size_px, 1, "uint8"), photo.interior, (),
        FilmArea(corners, (), np.zeros(4)), (),
    )  # fmt: skip
    given = BlockInput(
        "b", {"wide": CAMERA}, (ScanInput(photo.scan, "wide", 15.0),), Georeference(),
        ReferenceFiles("EPSG:5514", (), ()),
    )  # fmt: skip
    scans = ScanSet({"A": scan}, {}, ())
    mask = about(block, ("P1", "A"))
    masked = judged_scans(scans, given, number(mask)).oriented["A"].scan.usable
    assert masked is not None
    pixel = block.measurements["P1", "A"].pixel
    assert masked.at(pixel).tolist() == [False]
    assert masked.at(pixel + 200).tolist() == [True]
    assert judged_scans(scans, given, number(mask, Withdraw(1))) is scans


def pairs_of(block: Block, name: str, shift_m: float) -> Pairs:
    """Two places of a photo and where they lie on the ground, all of it moved."""
    photo, pixels = block.photos[name], np.array([[2000.0, 3000.0], [10000.0, 9000.0]])
    ground = photo.object_from_pixel(pixels, np.full(2, 250.0), CAMERA)[:, :2] + shift_m
    return tuple((*a, *b) for a, b in zip(pixels.tolist(), ground.tolist(), strict=True))


def test_a_photo_placed_anew_stands_where_it_was_clicked_until_that_is_undone__truth(
    block: Block,
) -> None:
    placing = PlacePhoto("A", pairs_of(block, "A", 400.0))
    placed = replay(block, number(placing)).block
    before, after = block.photos["A"], placed.photos["A"]
    # A vertical photo stands for one that is tilted by a degree: 2,750 m over the ground.
    assert np.abs(after.exterior.centre - before.exterior.centre - [400, 400, 0])[:2].max() < 90
    assert after.oriented
    assert after.prior.sigma_centre_m[0] < 100
    assert {placed.measurements[p, "A"].status for p in ("P1", "P2", "P3")} == {"unused"}
    assert placed.measurements["P1", "B"] is block.measurements["P1", "B"]
    assert placed.ties.photo.tolist() == [1, 1]
    undone = replay(block, number(placing, Withdraw(1))).block
    assert encode(undone) == encode(block)
    given_back = replay(block, number(placing, PlacePhoto("A", ()))).block
    assert encode(given_back) == encode(block)


def test_what_a_run_made_of_the_clicks_is_not_thrown_away__law(block: Block) -> None:
    placing = number(PlacePhoto("A", pairs_of(block, "A", 400.0)))
    placed = replay(block, placing).block.photos["A"]
    # The run began from the clicks, and found the photo somewhere near.
    moved = replace(placed.exterior, centre=placed.exterior.centre + 12.0)
    ran = block.with_photos({**block.photos, "A": replace(placed, exterior=moved)})
    assert encode(replay(ran, placing).block) == encode(ran)
    # Nor where it estimated the camera, whose principal point the photo hangs on.
    camera = replace(CAMERA, principal_point_mm=(0.02, -0.03))
    estimated = replace(ran, cameras={"wide": camera})
    assert encode(replay(estimated, placing, given={"wide": CAMERA}).block) == encode(estimated)
    lost = block.with_photos({**ran.photos, "A": replace(placed, exterior=moved, oriented=False)})
    assert replay(lost, placing).block.photos["A"].oriented


def test_clicks_go_to_the_georeference_of_the_next_run__law(block: Block) -> None:
    given = BlockInput("b", {}, (), Georeference(), ReferenceFiles("EPSG:5514", (), ()))
    pairs = pairs_of(block, "A", 0.0)
    placing = number(PlacePhoto("A", pairs), PlacePhoto("B", pairs), PlacePhoto("B", ()))
    assert with_clicks(given, placing).georeference.clicked == {"A": pairs}
    assert with_clicks(given, number(PlacePhoto("A", pairs), Withdraw(1))) is given
