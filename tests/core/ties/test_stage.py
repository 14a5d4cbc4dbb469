"""The stage as a whole, on photos rendered from a known ground."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from core.ties.chains import common_rays, rays_per_point
from core.ties.features import FeatureOptions
from core.ties.stage import TieOptions
from tests.core.ties.judging import intersected, match_ties, sigma_nought
from tests.core.ties.rendered import rendered_block, terrain, write

rng = np.random.default_rng
OPTIONS = TieOptions(features=FeatureOptions(max_features=2500))
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")


@pytest.fixture(scope="module")
def hilly(tmp_path_factory):
    return rendered_block(tmp_path_factory.mktemp("hilly"), 40.0)


@pytest.fixture(scope="module", params=[40.0, 0.0], ids=["hilly", "flat"])
def tied(request, hilly, tmp_path_factory):
    relief_m = request.param
    given, true = hilly if relief_m else rendered_block(tmp_path_factory.mktemp("flat"), 0.0)
    ties, reports, doubts = match_ties(given, rng(1), OPTIONS)
    return given, true, relief_m, ties, reports, doubts


def test_rays_meet_on_the_ground__truth(tied):
    _, true, relief_m, ties, _, _ = tied
    ground, residual = intersected(true, ties)
    assert np.abs(residual).max() < 1.0
    assert np.sqrt(np.mean(residual**2)) < 0.1
    above = ground[:, 2] - terrain(ground[:, 0], ground[:, 1], relief_m)
    assert np.abs(np.median(above)) < 0.1
    assert np.quantile(np.abs(above), 0.99) < 1.0


def test_residuals_spread_as_their_deviations_say__truth(tied):
    _, true, _, ties, _, _ = tied
    _, residual = intersected(true, ties)
    assert sigma_nought(ties, residual) == pytest.approx(1.0, abs=0.2)


def test_every_photo_is_tied_often_and_by_many_rays__truth(tied):
    _, _, _, ties, reports, doubts = tied
    assert all(np.sum(ties.photo == number) >= 150 for number in range(len(ties.photo_ids)))
    assert np.sum(rays_per_point(ties) >= 3) > 100
    assert all(report.tied for report in reports if report.overlap > 0.1)
    assert not [doubt for doubt in doubts if doubt.gravity >= 0.5]


def test_reports_count_the_ties_of_each_pair__law(tied):
    _, _, _, ties, reports, _ = tied
    for report in reports:
        numbers = ties.photo_ids.index(report.first), ties.photo_ids.index(report.second)
        assert report.ties <= len(common_rays(ties, *numbers)[0])
        assert report.ties == (len(common_rays(ties, *numbers)[0]) if report.tied else 0)
        assert report.agreeing <= report.matches


def test_same_seed_same_ties__law(hilly):
    few = hilly[0].with_photos({name: hilly[0].photos[name] for name in ("a1", "a2")})
    runs = [match_ties(few, rng(7), OPTIONS)[0] for _ in range(2)]
    assert np.array_equal(runs[0].pixels, runs[1].pixels)
    assert np.array_equal(runs[0].sigma_px, runs[1].sigma_px)


def test_a_photo_of_elsewhere_is_not_tied__truth(hilly, tmp_path):
    scan = tmp_path / "a2.tif"
    noise = cv2.GaussianBlur(np.random.default_rng(5).normal(size=(900, 900)), (0, 0), 3.0)
    write(scan, 128 + 400 * noise)
    photos = {name: hilly[0].photos[name] for name in ("a1", "a2")}
    photos["a2"] = replace(photos["a2"], scan=scan)
    ties, reports, doubts = match_ties(hilly[0].with_photos(photos), rng(0), OPTIONS)
    assert ties.count == 0
    kinds = {(doubt.kind, doubt.subject) for doubt in doubts}
    assert {("photo-not-tied", "a2"), ("pair-not-tied", "a1 a2")} <= kinds
    assert "block-in-parts" in {kind for kind, _ in kinds}
    assert [bool(report.reason) for report in reports] == [True]


def test_a_photo_laid_in_the_wrong_place_is_tied_and_told__truth(hilly):
    photos = {name: hilly[0].photos[name] for name in ("a1", "a2", "a3")}
    centre = photos["a2"].exterior.centre + np.array([9000.0, 4000.0, 0.0])
    start = replace(photos["a2"].exterior, centre=centre)
    photos["a2"] = replace(photos["a2"], exterior=start, approximate=start)
    ties, reports, doubts = match_ties(hilly[0].with_photos(photos), rng(0), OPTIONS)
    assert np.sum(ties.photo == 1) >= 150
    assert [report.unexpected for report in reports] == [True, False, True]
    assert {doubt.subject for doubt in doubts if doubt.kind == "photo-misplaced"} == {
        "a1 a2",
        "a2 a3",
    }


def test_one_photo_alone_has_no_ties_and_one_doubt__truth(hilly):
    alone = hilly[0].with_photos({"a1": hilly[0].photos["a1"]})
    ties, reports, doubts = match_ties(alone, rng(0), OPTIONS)
    assert ties.count == 0
    assert reports == ()
    assert [doubt.kind for doubt in doubts] == ["photo-not-tied"]


def test_positions_off_by_hundreds_of_metres_do_not_matter__truth(hilly):
    given, true = hilly
    noise = np.random.default_rng(3)
    moved = {}
    for name in ("a1", "a2", "b1"):
        photo = given.photos[name]
        prior = replace(photo.prior, sigma_centre_m=np.array([150.0, 150.0, 50.0]))
        centre = photo.exterior.centre + noise.normal(0, 150, 3) * np.array([1, 1, 0.3])
        start = replace(photo.exterior, centre=centre)
        moved[name] = replace(photo, exterior=start, approximate=start, prior=prior)
    ties, _, _ = match_ties(given.with_photos(moved), rng(0), OPTIONS)
    _, residual = intersected(true, ties)
    assert ties.count > 200
    assert np.abs(residual).max() < 1.0
