"""Photos placed by what the archive says, and by another source where that is missing."""

from dataclasses import replace

import numpy as np
import pytest

from core.errors import OrientationError
from tests.core.georeference.placing import georeference


def test_photos_lie_where_their_world_files_put_them__truth(tiny, placed):
    """Good ones are five to ten metres off, and know nothing of tilts."""
    for name, photo in placed.block.photos.items():
        away = photo.exterior.centre - tiny.truth.photos[name].exterior.centre
        above = photo.exterior.centre[2] - photo.ground_height_m
        assert np.hypot(*away[:2]) < 12 + above * np.radians(3.0)
        assert not photo.oriented
        assert photo.approximate is photo.exterior
        assert photo.ground_height_m == pytest.approx(tiny.reference.dem.mean_height(), abs=15.0)


def bare(scans, folder):
    """The scans in a folder of their own, without the world files beside them."""
    found = {}
    for name, scan in scans.oriented.items():
        path = folder / scan.scan.path.name
        path.symlink_to(scan.scan.path)
        found[name] = replace(scan, scan=replace(scan.scan, path=path))
    return replace(scans, oriented=found)


def test_without_any_source_there_is_nothing_to_begin_with__truth(given, scan_set, tmp_path):
    nowhere = replace(given, georeference=replace(given.georeference, footprints=None))
    with pytest.raises(OrientationError) as told:
        georeference(nowhere, bare(scan_set, tmp_path))
    assert "world file" in told.value.remedy


def test_another_source_stands_in_with_a_doubt__truth(given, scan_set, tmp_path):
    found = georeference(given, bare(scan_set, tmp_path))
    said = [d.message for d in found.doubts if d.kind == "georeference-missing"]
    assert (
        said
        == ["There is no world file for this scan; it was placed by its footprint instead."] * 6
    )


def test_who_asks_for_no_source_misses_none__truth(given, scan_set):
    open_ended = replace(given, georeference=replace(given.georeference, source="none"))
    found = georeference(open_ended, scan_set)
    assert len(found.block.photos) == 6
    assert not [d for d in found.doubts if d.kind == "georeference-missing"]
