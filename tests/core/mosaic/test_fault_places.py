"""Places at which a mosaic is wrong, with faults that were put in."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio
import shapely

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.influence import influence_of
from core.block import TiePoints
from core.control.prediction import covariances_of
from core.mosaic.fault_places import (
    HOUSE_M,
    FaultPlace,
    cut_houses,
    ground_places,
    misfit_findings,
    seam_places,
    tie_places,
    tied_pairs,
    worst_places,
)
from core.mosaic.misfit import BlockErrors
from core.mosaic.seam_fit import SeamFit
from core.raster.dem import open_dem
from core.synthetic.options import CRS
from sessions.session import Session


@pytest.fixture(scope="module")
def run(tiny_run):
    """The tiny block, its mosaic, and what it predicts."""
    with Session.open(tiny_run.folder, "test") as session:
        report = session.products.latest_value("adjustment")
        mosaic = session.products.latest_value("mosaic")
    influence = influence_of(report, AdjustmentOptions())
    errors = BlockErrors(report, covariances_of(influence), tiny_run.reference.dem, 0.25, 0.5)
    return tiny_run, mosaic, errors


def fit_of(run, rng, off=(), shift=(2.4, -1.8), known=0.04):
    """Matches along the longest seam of two photos, so well known; some of them are off."""
    _, mosaic, _ = run
    seams = mosaic.seams
    pairs = [(a, b, a.area.intersection(b.area)) for a in seams for b in seams if a != b]
    one, other, line = max(pairs, key=lambda pair: pair[2].length)
    along = np.linspace(0, 1, 40)
    places = shapely.get_coordinates(
        shapely.line_interpolate_point(shapely.line_merge(line), along, normalized=True)
    )
    shifts = rng.normal(0, 0.2, (40, 2))
    shifts[list(off)] += shift
    figures = (line.length, 40, 0.0, 0.0, 40, (0.0, 0.0), 0.0)
    matches, spreads = np.hstack([places, shifts]), np.tile(known * np.eye(2), (40, 1, 1))
    return SeamFit((one.photo_id, other.photo_id), *figures, matches, spreads)


@pytest.mark.parametrize("seed", [8101, 8102, 8103])
def test_neighbouring_matches_that_agree_are_a_place__truth(run, seed):
    rng = np.random.default_rng(seed)
    fit = fit_of(run, rng, off=range(12, 17))
    (place,) = seam_places([fit], run[2])
    assert place.photo_ids == fit.photo_ids
    assert place.shift_m == pytest.approx((2.4, -1.8), abs=0.5)
    away = np.hypot(*(fit.matches[:, :2] - (place.east, place.north)).T)
    assert 12 <= int(np.argmin(away)) <= 16
    # One match alone may be chance, and small shifts are expected.
    assert seam_places([fit_of(run, rng, off=[14])], run[2]) == []
    assert seam_places([fit_of(run, rng)], run[2]) == []
    # Along an edge that is alone in its patches a shift of metres means nothing.
    assert seam_places([fit_of(run, rng, off=range(12, 17), known=9.0)], run[2]) == []


def test_a_house_is_named_where_a_seam_cuts_it__truth(run):
    _, mosaic, errors = run
    fit = fit_of(run, np.random.default_rng(1))
    x, y = fit.matches[20, :2]
    houses = [shapely.box(x - 6, y - 6, x + 6, y + 6), shapely.box(x - 6, y + 60, x + 6, y + 70)]
    found = cut_houses(mosaic.seams, houses, errors, 2.0)
    named = [one for one in found if set(one.photo_ids) == set(fit.photo_ids)]
    photos = errors.report.block.photos
    first, second = (photos[name].exterior.centre for name in fit.photo_ids)
    # A roof is displaced away from the nadir by its height over that of the flight.
    lean = (
        HOUSE_M
        * np.hypot(*(first - second)[:2])
        / (first[2] - photos[fit.photo_ids[0]].ground_height_m)
    )
    assert [one.length_m for one in named] == pytest.approx([lean], rel=0.05)
    assert (named[0].east, named[0].north) == pytest.approx((x, y), abs=8)


def test_a_spike_of_the_heights_is_named_with_its_size__truth(run, tmp_path):
    tiny, mosaic, errors = run
    sound = open_dem([tiny.folder / "dem.tif"], CRS)
    assert ground_places(sound, mosaic.grid.bounds, mosaic.seams, errors) == []
    seam = max(mosaic.seams, key=lambda one: one.area.area)
    centre = errors.report.block.photos[seam.photo_id].exterior.centre[:2]
    corners = shapely.get_coordinates(seam.area.buffer(-30))
    x, y = corners[np.argmax(np.hypot(*(corners - centre).T))]
    with rasterio.open(tiny.folder / "dem.tif") as file:
        values, profile, (row, column) = file.read(1), file.profile, file.index(x, y)
    values[row - 1 : row + 1, column - 1 : column + 1] += 25.0
    with rasterio.open(tmp_path / "dem.tif", "w", **profile) as file:
        file.write(values, 1)
    spiked = open_dem([tmp_path / "dem.tif"], CRS)
    (place,) = ground_places(spiked, mosaic.grid.bounds, mosaic.seams, errors)
    assert place.height_m == pytest.approx(25, abs=3)
    assert np.hypot(place.east - x, place.north - y) < 12
    assert place.photo_ids == (seam.photo_id,)
    # What is taken to be higher is shown nearer to the nadir than it is.
    assert np.dot(place.shift_m, (x, y) - centre) < 0


def test_ties_of_two_photos_that_agree_on_a_shift_are_a_place__truth(run):
    _, mosaic, errors = run
    assert tie_places(tied_pairs(errors), errors) == []
    ties, positions = errors.report.block.ties, errors.report.tie_positions
    own = np.flatnonzero((ties.photo == 0) & np.isfinite(positions[ties.point, 0]))
    middle = np.median(positions[ties.point[own], :2], axis=0)
    away = np.hypot(*(positions[ties.point[own], :2] - middle).T)
    group = own[np.argsort(away)[:25]]
    pixels = ties.pixels.copy()
    pixels[group] += (4.0, 0.0)
    wrong = TiePoints(ties.photo_ids, ties.point, ties.photo, pixels, ties.sigma_px)
    block = replace(errors.report.block, ties=wrong)
    planted = replace(errors, report=replace(errors.report, block=block))
    found = worst_places((), (), mosaic.seams, (), errors=planted, grid=mosaic.grid, dem=None)
    assert found
    # Third photos see the group: they tell which of two it is.
    assert {place.photo_ids[0] for place in found} == {ties.photo_ids[0]}
    reach = np.hypot(*(positions[ties.point[group], :2] - middle).T).max() + 100
    assert all(np.hypot(place.east - middle[0], place.north - middle[1]) < reach for place in found)


@pytest.mark.parametrize(("share", "tell"), [(0.5, False), (0.02, True)])
def test_ties_on_roofs_disagree_with_the_ground_and_not_with_each_other__law(run, share, tell):
    """Where a town stands high its ties do; a few that stand so alone are told."""
    _, _, errors = run
    positions = errors.report.tie_positions[:, :2]
    positions = positions[np.isfinite(positions).all(axis=1)]
    away = np.hypot(*(positions - np.median(positions, axis=0)).T)
    reach = np.quantile(away, share)

    class Lower:
        def heights(self, points):
            aside = np.hypot(*(points[:, :2] - np.median(positions, axis=0)).T)
            return errors.heights.heights(points) - 15.0 * (aside <= reach)

    lower = replace(errors, heights=Lower())
    assert bool(tie_places(tied_pairs(lower), lower)) == tell


def test_the_list_is_one_with_what_is_surely_there_first__law(run):
    tiny, mosaic, errors = run
    fit = fit_of(run, np.random.default_rng(5), off=range(30, 36))
    places = worst_places(
        (), [fit], mosaic.seams, (), errors=errors, grid=mosaic.grid, dem=tiny.reference.dem
    )
    assert [place.kind for place in places] == ["seam"]
    there = [place.length_m - 2 * place.sigma_m for place in places]
    assert there == sorted(there, reverse=True)


def test_the_photo_that_fits_none_of_its_neighbours_is_told_first__law(run):
    """Three photos about one that is off: it is in every pair, whichever way these are written."""
    _, mosaic, errors = run
    odd, *others = sorted({seam.photo_id for seam in mosaic.seams})[2:6]
    rng, fits = np.random.default_rng(6), []
    for number, name in enumerate(others):
        fit = fit_of(run, rng, off=range(8, 30))
        pair = (odd, name) if number % 2 else (name, odd)
        fits.append(replace(fit, photo_ids=pair))
    places = worst_places((), fits, mosaic.seams, (), errors=errors, grid=mosaic.grid, dem=None)
    assert [place.photo_ids[0] for place in places] == [odd] * len(others)
    # Written the other way round, a shift is that of the other photo.
    ways = {place.photo_ids[1]: place.shift_m[0] > 0 for place in places}
    assert [ways[name] for name in others] == [False, True, False]


def test_only_places_off_the_reference_by_more_than_predicted_are_a_finding__truth():
    off = FaultPlace("reference", 10.0, 20.0, ("A",), (3.0, 4.0), 0.1, (0.5, 0.5), significant=True)
    near = replace(off, significant=False)
    (found,) = misfit_findings([off, replace(off, east=90.0), replace(off, kind="house"), near])
    assert (found.kind, found.grave) == ("misfit-places", 1)
    assert dict(found.values) == {"count": "2", "metres": "5.0", "east": "10", "north": "20"}
    assert misfit_findings([near, replace(off, kind="seam")]) == ()
