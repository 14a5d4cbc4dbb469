"""Reference points are looked for wherever the photos may lie."""

from core.progress import Work
from core.reference.stage import find_reference_points


def test_reference_points_lie_in_what_is_searched__truth(given, scan_set, placed):
    scans = {name: scan.scan for name, scan in scan_set.oriented.items()}
    found = find_reference_points(placed.block, scans, given.reference, 0.35, Work())
    west, south, east, north = placed.block.search_bounds
    places = found.points.positions
    assert len(places) > 60
    assert ((places[:, :2] >= [west, south]) & (places[:, :2] <= [east, north])).all()
    assert set(found.sources.values()) == {"junction", "salient"}
