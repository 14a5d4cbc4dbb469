"""The stage as a whole, on photos rendered from a known ground."""

import numpy as np
import pytest
from core.block.chains import common_rays, rays_per_point
from core.block.features import FeatureOptions
from core.block.tie_points import TieOptions, match_ties
from dataclasses import replace

from tests.core.block.judging import intersected, sigma_nought
from tests.core.block.rendered import rendered_block, terrain, write

OPTIONS = TieOptions(features=FeatureOptions(max_features=3000, threads=2))
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")


@pytest.fixture(scope="module", params=[40.0, 0.0], ids=["hilly", "flat"])
def tied(request, tmp_path_factory):
    given, true = rendered_block(tmp_path_factory.mktemp("block"), request.param)
    ties, reports, doubts = match_ties(given, OPTIONS, rng=np.random.default_rng(1))
    return given, true, request.param, ties, reports, doubts


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


def test_same_seed_same_ties__law(tmp_path):
    given, _ = rendered_block(tmp_path, 30.0)
    few = given.with_photos({name: given.photos[name] for name in ("a1", "a2")})
    runs = [match_ties(few, OPTIONS, rng=np.random.default_rng(7))[0] for _ in range(2)]
    assert np.array_equal(runs[0].pixels, runs[1].pixels)
    assert np.array_equal(runs[0].sigma_px, runs[1].sigma_px)


def test_a_photo_of_elsewhere_is_not_tied__truth(tmp_path):
    given, _ = (
        rendered_block(tmp_path / "..", 20.0, seed=1) if False else rendered_block(tmp_path, 20.0)
    )
    rng = np.random.default_rng(5)
    stranger = given.photos["a2"]
    noise = rng.normal(size=(900, 900))
    import cv2

    write(tmp_path / "a2.tif", 128 + 400 * cv2.GaussianBlur(noise, (0, 0), 3.0))
    three = given.with_photos({n: given.photos[n] for n in ("a1", "a2", "a3")})
    ties, reports, doubts = match_ties(three, OPTIONS, rng=np.random.default_rng(1))
    assert not np.any(ties.photo == ties.photo_ids.index(stranger.photo_id))
    kinds = {(doubt.kind, doubt.subject) for doubt in doubts}
    assert ("photo-not-tied", "a2") in kinds
    assert ("pair-not-tied", "a1 a2") in kinds
    assert "block-in-parts" in {kind for kind, _ in kinds}
    refused = [report for report in reports if "a2" in (report.first, report.second)]
    assert all(report.reason for report in refused)


def test_one_photo_alone_has_no_ties_and_one_doubt__truth(tmp_path):
    given, _ = rendered_block(tmp_path, 20.0)
    alone = given.with_photos({"a1": given.photos["a1"]})
    ties, reports, doubts = match_ties(alone, OPTIONS)
    assert ties.count == 0
    assert reports == ()
    assert [doubt.kind for doubt in doubts] == ["photo-not-tied"]


def test_positions_off_by_hundreds_of_metres_do_not_matter__truth(tmp_path):
    given, true = rendered_block(tmp_path, 40.0)
    rng = np.random.default_rng(3)
    moved = {}
    for name, photo in given.photos.items():
        prior = replace(photo.prior, sigma_centre_m=np.array([150.0, 150.0, 50.0]))
        centre = photo.exterior.centre + rng.normal(0, 150, 3) * np.array([1, 1, 0.3])
        start = replace(photo.exterior, centre=centre)
        moved[name] = replace(photo, exterior=start, approximate=start, prior=prior)
    ties, _, _ = match_ties(given.with_photos(moved), OPTIONS)
    _, residual = intersected(true, ties)
    assert ties.count > 300
    assert np.abs(residual).max() < 1.0
