"""A photo of doubtful place, turn and scale found on the reference as a whole."""

from dataclasses import replace

import numpy as np
import pytest

from core.arrays import locked
from core.block import ExteriorPrior
from core.geometry.exterior import ExteriorOrientation
from core.localisation.photo_placement import (
    laid_on_ground,
    placement_covariance,
)
from core.matching.global_search import Laid, Turn, angle_field, apart, distinct, turned
from core.matching.patches import OpenPhoto
from core.raster.grid import Grid


def displaced(tiny, name, shift_m, turn, scale, prior) -> OpenPhoto:
    """A photo as an archive would have it: vertical, shifted, turned and scaled."""
    photo = tiny.photos[name]
    true = photo.exterior
    above = (true.centre[2] - photo.ground_height_m) * scale
    under = photo.object_from_pixel(
        np.array([photo.size_px]) / 2, np.array([photo.ground_height_m]), tiny.truth.camera
    )[0]
    centre = np.array([*(under[:2] + shift_m), photo.ground_height_m + above])
    start = ExteriorOrientation(centre, 0.0, 0.0, true.kappa + turn)
    sigma_m, sigma_height_m, sigma_kappa = prior
    sigmas = ExteriorPrior(
        locked([sigma_m, sigma_m, sigma_height_m]), locked([0.01, 0.01, sigma_kappa])
    )
    moved = replace(photo, exterior=start, approximate=start, prior=sigmas)
    return OpenPhoto(moved, tiny.truth.camera, tiny.scans[name])


def astray_m(tiny, name, exterior) -> float:
    """RMS distance on the ground, over the photo, between a placement and the truth."""
    photo, camera = tiny.photos[name], tiny.truth.camera
    share = np.stack(np.meshgrid([0.2, 0.5, 0.8], [0.2, 0.5, 0.8]), axis=-1).reshape(-1, 2)
    pixels = share * np.array(photo.size_px)
    heights = np.full(len(pixels), photo.ground_height_m)
    true = photo.object_from_pixel(pixels, heights, camera)
    found = photo.with_exterior(exterior, False).object_from_pixel(pixels, heights, camera)
    return float(np.sqrt(np.mean(np.sum((found - true) ** 2, axis=1))))


def test_a_placement_is_the_turn_about_the_nadir_it_says__law(tiny):
    name = tiny.names[0]
    opened = tiny.opened(name)
    turn = Turn(0.5, 1.1, 30.0, -20.0, 0.4, 9.0)
    was = opened.photo.exterior
    ground = opened.photo.ground_height_m
    there = turn.moved(was, was.centre[:2], ground)
    np.testing.assert_allclose(there.centre[:2], was.centre[:2] + np.array([30.0, -20.0]))
    assert there.centre[2] - ground == pytest.approx(1.1 * (was.centre[2] - ground))
    about = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    share = np.array([[0.3, 0.4], [0.7, 0.6]]) * np.array(opened.photo.size_px)
    heights, camera = np.full(2, ground), tiny.truth.camera
    before = opened.photo.object_from_pixel(share, heights, camera)[:, :2] - was.centre[:2]
    after = opened.at(there).photo.object_from_pixel(share, heights, camera)[:, :2]
    np.testing.assert_allclose(
        after - there.centre[:2], 1.1 * before @ about.T, atol=0.2
    )  # curvature apart


def test_the_picture_turns_as_the_photo_does__law():
    """Counter-clockwise on the ground, about the middle."""
    side = 101
    field = np.zeros((side, side), np.complex64)
    field[50, 80] = 1.0  # east of the middle
    laid = Laid(Grid(0.0, 101.0, 1.0, side, side), field, np.ones((side, side), bool))
    there, mask = turned(laid, np.pi / 2, 1.0)
    assert np.unravel_index(np.abs(there).argmax(), there.shape) == (20, 50)  # north of it
    assert mask[50, 50]
    smaller, _ = turned(laid, 0.0, 0.5)
    assert np.unravel_index(np.abs(smaller).argmax(), smaller.shape) == (50, 65)


@pytest.mark.parametrize("kappa", [-2.0, 0.3, np.pi / 2])
def test_turned_angles_are_the_angles_of_the_turned_picture__law(kappa):
    """A disc of smooth waves, turned before and after the angles are taken."""
    side = 201
    down, right = np.mgrid[:side, :side] - side // 2
    disc = np.hypot(down, right) < 80

    def waves(turn):
        along = np.cos(turn) * right - np.sin(turn) * down
        across = np.sin(turn) * right + np.cos(turn) * down
        image = np.sin(along / 9) + np.cos(across / 6 + along / 15)
        return angle_field(np.asarray(image, np.float32), disc)

    laid = Laid(Grid(0.0, side, 1.0, side, side), waves(0.0), disc)
    there, mask = turned(laid, kappa, 1.0)
    # The picture turned by kappa shows at p what was at p turned back by kappa.
    expected = waves(kappa)
    inner = mask & (np.hypot(down, right) < 70)
    same = np.sum((there * np.conj(expected))[inner]).real
    whole = np.sqrt(np.sum(np.abs(there[inner]) ** 2) * np.sum(np.abs(expected[inner]) ** 2))
    assert same / whole > 0.98


def test_the_laid_photo_is_the_ground__truth(tiny):
    """At the true orientation it equals the ortho of its day."""
    opened = tiny.opened(tiny.names[0])
    east, north = (float(value) for value in opened.photo.exterior.centre[:2])
    half = 0.8 * opened.width_m
    grid = Grid.over((east - half, north - half, east + half, north + half), 4.0)
    laid = laid_on_ground(opened, tiny.reference, grid)
    patch = tiny.archival().ortho.read(laid.grid)
    both = laid.mask & patch.mask
    assert both.mean() > 0.3
    field = angle_field(patch.values, patch.mask)
    same = np.sum((laid.field * np.conj(field))[both]).real
    whole = np.sqrt(np.sum(np.abs(laid.field[both]) ** 2) * np.sum(np.abs(field[both]) ** 2))
    assert same / whole > 0.5


def test_the_best_turns_differ__law():
    turns = [
        Turn(0.0, 1.0, 0.0, 0.0, 0.5, 9.0),
        Turn(0.02, 1.0, 3.0, 0.0, 0.5, 8.0),
        Turn(np.pi, 1.0, 0.0, 0.0, 0.4, 7.0),
        Turn(-np.pi + 0.01, 1.0, 0.0, 0.0, 0.4, 6.5),
        Turn(0.0, 1.0, 200.0, 0.0, 0.4, 6.0),
    ]
    assert distinct(turns[::-1], 5, 1000.0) == [turns[0], turns[2], turns[4]]
    assert distinct(turns, 1, 1000.0) == [turns[0]]
    assert distinct([], 3, 1000.0) == []
    assert distinct(turns, 5, 1000.0, beside=turns[:1]) == [turns[2], turns[4]]
    assert apart([turns[4], *turns], 2, 1000.0) == [turns[4], turns[0]]


def test_a_placed_photo_knows_its_middle_better_than_its_corners__truth(tiny):
    opened = tiny.opened(tiny.names[0])
    covariance = placement_covariance(opened, 5.0)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    prior = np.concatenate([opened.photo.prior.sigma_centre_m, opened.photo.prior.sigma_angles])
    assert (np.sqrt(np.diag(covariance)) <= prior + 1e-9).all()
