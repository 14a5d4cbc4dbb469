"""What an unknown principal distance may be, before the photos tell."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from core.georeference.principal_distance import camera_types, proposed_distances, types_named
from core.results import BlockInput
from core.scans.stage import ScanSet
from tests.core.georeference.placing import georeference

LARGE = (230.0, 230.0)


@pytest.mark.parametrize("words", [("Wild Heerbrugg", "RC8"), ("", "rc 8"), ("", "RC8")])
def test_a_type_is_known_however_it_is_written__truth(words: tuple[str, str]) -> None:
    (found,) = proposed_distances(words[0], words[1], LARGE)
    assert found == (152.4, 0.5)


def test_a_camera_of_several_lenses_may_have_any_of_them_the_most_frequent_first__truth() -> None:
    distances = [distance for distance, _ in proposed_distances("", "RC10", LARGE)]
    assert [round(distance) for distance in distances] == [153, 88, 214, 305]


def test_no_type_is_taken_for_another__truth() -> None:
    assert types_named("", "RC99") == ()
    assert {kind.model for kind in types_named("", "RC5")} == {"RC5"}


def test_without_a_type_every_distance_between_the_usual_ones_is_within_two_deviations__law() -> (
    None
):
    usual = proposed_distances("", "", LARGE)
    for distance in np.linspace(85, 310, 200):
        assert min(abs(distance - mean) / sigma for mean, sigma in usual) < 2


def test_smaller_frames_have_lenses_in_proportion__truth() -> None:
    large, small = (proposed_distances("", "", (side, side)) for side in (230.0, 115.0))
    assert [a for a, _ in small] == pytest.approx([b / 2 for b, _ in large], abs=0.01)


def test_the_table_tells_of_types_and_not_of_single_cameras__law() -> None:
    assert len(camera_types()) > 20
    assert min(kind.certificates for kind in camera_types()) >= 5


def unknown(
    given: BlockInput, scans: ScanSet, make: str = "", model: str = "", **source: float
) -> tuple[BlockInput, ScanSet]:
    """A block of whose camera only so much is said, and its scans."""
    (name,) = given.cameras
    camera = scans.cameras.get(name, given.cameras[name])
    distances = proposed_distances(make, model, camera.frame_mm)
    camera = replace(camera.at_distance(*distances[0]), distances_mm=distances)
    cameras = {name: camera}
    described = replace(given, cameras=cameras, georeference=replace(given.georeference, **source))
    return described, replace(scans, cameras=cameras)


def test_flying_height_over_scale_is_the_principal_distance__truth(
    tiny: Any, given: BlockInput, scan_set: ScanSet
) -> None:
    height = np.mean([photo.exterior.centre[2] for photo in tiny.truth.photos.values()])
    placed = georeference(*unknown(given, scan_set, flying_height_m=float(height)))
    (camera,) = placed.block.cameras.values()
    true = tiny.truth.camera.principal_distance_mm
    # World files tell the scale of a photo to four in a hundred, tilt and relief included.
    assert abs(camera.principal_distance_mm - true) < 2 * camera.sigma_principal_distance_mm
    assert camera.sigma_principal_distance_mm < 0.08 * true
    assert len(camera.distances_mm) == 1


def test_flying_heights_tell_which_lens_of_a_type_it_was__truth(
    tiny: Any, given: BlockInput, scan_set: ScanSet
) -> None:
    height = np.mean([photo.exterior.centre[2] for photo in tiny.truth.photos.values()])
    placed = georeference(*unknown(given, scan_set, model="RC10", flying_height_m=float(height)))
    (camera,) = placed.block.cameras.values()
    assert camera.distances_mm == ((213.73, 0.5),)


def test_without_heights_all_usual_distances_stay_open__law(
    given: BlockInput, scan_set: ScanSet
) -> None:
    described, scans = unknown(given, scan_set)
    placed = georeference(described, scans)
    assert dict(placed.block.cameras) == dict(described.cameras)
