"""The photos of the tiny block found together, whatever their georeference says."""

from dataclasses import replace

import numpy as np
import pytest

from core.doubts import Failure
from core.geometry.exterior import ExteriorOrientation
from core.localisation.block_placement import PlacedBlock, Placement
from core.localisation.initial_orientation import Site
from core.localisation.photo_orientation import OrientedPhoto
from core.localisation.stage import likelier, localise_again, localise_photos, orient_photos
from core.matching.global_search import Turn
from core.matching.reference import open_reference
from core.progress import Work
from core.reference.stage import find_reference_points
from core.synthetic.truth import judge_orientations

pytestmark = pytest.mark.slow


def test_photos_that_are_off_are_found_and_again_where_they_were_put__truth(
    tiny, given, scan_set, placed
):
    """A hundred metres off to either side, turned by two degrees, fifty too high."""
    off = np.array([90.0, -70.0, 50.0])
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
    scans = {name: scan.scan for name, scan in scan_set.oriented.items()}
    features = find_reference_points(poor.block, scans, given.reference, 0.35, work=Work())
    options = given.localisation
    found = localise_photos(poor, scans, features, given.reference, options, Work())
    ground = judge_orientations(tiny.truth, found.block).ground_m
    assert all(photo.oriented for photo in found.block.photos.values())
    assert ground.max() < 4.0
    assert set(found.features) == set(tiny.names)
    # A photo that control lost is carried again by its ties; the others stay where they are.
    lost = tiny.names[0]
    waiting = replace(poor.block.photos[lost], oriented=False)
    adjusted = found.block.with_photos({**found.block.photos, lost: waiting})
    again = localise_again(found, adjusted, scans, features, given.reference, Work())
    assert again.block.photos[lost].oriented
    assert [d.subject for d in again.doubts if d.kind == "photo-orientation"] == [lost]
    for name in tiny.names[1:]:
        assert again.block.photos[name] is adjusted.photos[name]
    assert again.features is found.features
    assert not again.weak.measurements


def test_where_no_photo_stands_at_the_likeliest_places_the_others_are_tried__truth(
    tiny, given, scan_set, placed
):
    """Three places of the block are 700 m off, the fourth is right; its sources are far off too."""
    options = given.localisation
    scans = {name: scan.scan for name, scan in scan_set.oriented.items()}
    features = find_reference_points(placed.block, scans, given.reference, 0.35, work=Work())
    reference = open_reference(given.reference, placed.block.search_bounds)
    site = Site(reference, scans, features.points, features.sources)
    covariance = np.diag(np.append(np.full(3, 8.0), np.full(3, np.radians(0.2))) ** 2)
    off = [*(700.0 * np.array([np.cos(a), np.sin(a), 0.0]) for a in (0.0, 2.0, 4.0)), np.zeros(3)]

    def places_of(name):
        true = tiny.photos[name].exterior
        return tuple(
            Placement(replace(true, centre=true.centre + one), covariance, Turn(0.0, 1.0))
            for one in off
        )

    places = {name: places_of(name) for name in tiny.names}
    known = {
        name: replace(approximation, hypotheses=(places[name][0].exterior,))
        for name, approximation in placed.approximations.items()
    }
    lost = replace(placed, approximations=known)

    def standing(count):
        some = {name: every[:count] for name, every in places.items()}
        part = PlacedBlock(tiny.names, (Turn(0.0, 1.0),) * count, some)
        found = orient_photos(lost, (part,), site, options, Work())
        return {name: one for name, one in found.items() if isinstance(one, OrientedPhoto)}

    assert options.placement.hypotheses == len(off) - 1
    assert not standing(options.placement.hypotheses)
    right = standing(len(off))
    assert len(right) > len(tiny.names) / 2
    for name, found in right.items():
        away = found.exterior.centre - tiny.photos[name].exterior.centre
        assert np.linalg.norm(away[:2]) < 25.0


def test_of_two_results_the_one_less_likely_chance_is_taken__law():
    exterior = ExteriorOrientation(np.zeros(3), 0.0, 0.0, 0.0)

    def stands(e_value):
        return OrientedPhoto(exterior, np.eye(6), (), np.zeros(0, np.int64), (), e_value)

    sure, unsure, fallen, lost = stands(20.0), stands(4.0), Failure("fell"), Failure("lost")
    assert likelier(sure, unsure) is likelier(unsure, sure) is sure
    assert likelier(fallen, unsure) is likelier(unsure, fallen) is unsure
    assert likelier(fallen, lost) is lost
