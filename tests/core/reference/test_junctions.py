"""The planar graph and its junctions: known networks, and a brute-force graph."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from core.formats.roads import Roads, read_roads
from core.raster.dem import open_dem
from core.reference.junctions import find_junctions
from core.reference.road_graph import clusters, planar_graph
from tests.core.raster_files import CRS, NORTH, WEST, place, write_raster


def sigmas_m(plan):
    """Of ortho and heights, the same everywhere."""
    return np.tile((0.25, 0.5), (len(plan), 1))


def roads_of(*lines, levels=None, kinds=None, layers=None) -> Roads:
    origin = np.array([WEST, NORTH - 1000])
    made = np.array([shapely.LineString(np.array(line, float) + origin) for line in lines], object)
    count = len(lines)
    text = np.array([""] * count, dtype=object)
    return Roads(
        CRS, made, np.array(layers or ["roads"] * count, object),
        np.array(kinds or [""] * count, object), text,
        np.array(levels or [0] * count, np.int64), np.full(count, np.nan),
    )  # fmt: skip


@pytest.fixture(scope="module")
def flat(tmp_path_factory):
    heights = np.full((100, 100), 250, np.float32)
    path = write_raster(tmp_path_factory.mktemp("dem") / "d.tif", heights, place(10.0))
    return open_dem(path, CRS)


def junctions(flat, *lines, bridges=None, mask=None, **attributes):
    return find_junctions(
        planar_graph(roads_of(*lines, **attributes)),
        flat,
        sigmas_m=sigmas_m,
        bridges=bridges,
        mask=mask,
    )


def local(junction):
    return junction.position[:2] - [WEST, NORTH - 1000]


CROSS = ([(100, 500), (500, 500)], [(300, 300), (300, 700)])


def test_lines_that_run_through_each_other_meet__truth(flat):
    (found,) = junctions(flat, *CROSS)
    np.testing.assert_allclose(local(found), [300, 500], atol=1e-6)
    assert found.degree == 4
    np.testing.assert_allclose(np.degrees(found.arm_azimuths), [0, 90, 180, 270], atol=1e-6)
    assert found.position[2] == 250
    assert found.junction_id == f"J{round((WEST + 300) * 10)}_{round((NORTH - 500) * 10)}"
    assert not found.compact


def test_attribute_breaks_are_no_junctions__truth(flat):
    pieces = [[(i * 10, 500), (i * 10 + 10, 500)] for i in range(10, 60)]
    assert not junctions(flat, *pieces)
    (found,) = junctions(flat, *pieces, [(300, 500), (300, 800)])
    assert found.degree == 3


@pytest.mark.parametrize("gap", [-0.4, -0.001, 0.0, 0.3, 0.49])
def test_ends_that_nearly_touch_meet__truth(flat, gap):
    (found,) = junctions(flat, CROSS[0], [(300, 500 + gap), (300, 700)])
    assert found.degree == 3
    np.testing.assert_allclose(local(found), [300, 500], atol=0.5)


def test_ends_farther_apart_do_not_meet__truth(flat):
    assert not junctions(flat, CROSS[0], [(300, 500.6), (300, 700)])


def test_three_loose_ends_are_one_node_wherever_they_lie__law(flat):
    # Rounding to a grid would part them somewhere; distance does not.
    for shift in np.linspace(0, 1, 23):
        a, b = 300 + shift, 500 + shift / 3
        (found,) = junctions(
            flat,
            [(a, b), (100, 500)],
            [(a + 0.2, b + 0.1), (500, 510)],
            [(a - 0.1, b + 0.3), (290, 800)],
        )
        assert found.degree == 3


def test_parallel_edges_stay_apart__truth():
    graph = planar_graph(
        roads_of([(100, 500), (300, 600), (500, 500)], [(100, 500), (300, 400), (500, 500)],
                 [(100, 500), (500, 500)], [(0, 500), (100, 500)], [(500, 500), (600, 500)])
    )  # fmt: skip
    assert len(graph.edges) == 5
    assert sorted(graph.degrees.tolist()) == [1, 1, 4, 4]


def test_a_loop_counts_twice__truth(flat):
    loop = [(300, 500), (350, 550), (300, 600), (250, 550), (300, 500)]
    (found,) = junctions(flat, loop, [(300, 300), (300, 500)])
    assert found.degree == 3


def test_a_road_drawn_in_two_layers_counts_once__truth(flat):
    shifted = [(100, 500.3), (300, 500.1), (500, 500.2)]
    assert not junctions(flat, CROSS[0], shifted)
    (found,) = junctions(flat, CROSS[0], shifted, [(300, 500), (300, 700)])
    assert found.degree == 3


def test_short_stubs_are_no_arms__truth(flat):
    assert not junctions(flat, CROSS[0], [(300, 500), (300, 504)])
    assert junctions(flat, CROSS[0], [(300, 500), (300, 506)])


def test_a_bridge_meets_only_where_it_ends__truth(flat):
    road = [(100, 500), (500, 500)]
    south, bridge, north = (
        [(300, 300), (300, 480)],
        [(300, 480), (300, 520)],
        [(300, 520), (300, 700)],
    )
    assert not junctions(flat, road, south, bridge, north, levels=[0, 0, 1, 0])
    assert len(junctions(flat, road, south, bridge, north)) == 1
    # Where the bridge ends, a road turns off.
    (found,) = junctions(
        flat, road, south, bridge, north, [(300, 520), (450, 560)], levels=[0, 0, 1, 0, 0]
    )
    np.testing.assert_allclose(local(found), [300, 520], atol=1e-6)
    # A bridge that ends on the road itself meets it.
    (found,) = junctions(flat, road, [(300, 500), (300, 700)], levels=[0, 1])
    assert found.degree == 3


def test_bridge_areas_part_crossings__truth(flat):
    area = shapely.box(WEST + 290, NORTH - 510, WEST + 310, NORTH - 490)
    assert not junctions(flat, *CROSS, bridges=area)
    assert len(junctions(flat, *CROSS, bridges=shapely.Polygon())) == 1
    # But roads that end there do meet.
    ends = [CROSS[0], [(300, 500), (300, 700)]]
    assert len(junctions(flat, *ends, bridges=area)) == 1


def test_close_junctions_are_one_compact_one__truth(flat):
    # An offset crossing, five metres from arm to arm.
    (found,) = junctions(flat, CROSS[0], [(300, 500), (300, 700)], [(305, 300), (305, 500)])
    assert found.compact
    assert found.degree == 4
    np.testing.assert_allclose(local(found), [302.5, 500], atol=1e-6)
    # A dual carriageway crossed by a road.
    (found,) = junctions(
        flat, CROSS[0], [(300, 300), (300, 700)], [(306, 300), (306, 700)],
    )  # fmt: skip
    assert found.compact


def test_a_row_of_driveways_is_not_one_junction__truth(flat):
    drives = [[(100 + 7 * i, 500), (100 + 7 * i, 540)] for i in range(1, 40)]
    found = junctions(flat, CROSS[0], *drives)
    assert len(found) > 10
    places = np.array([local(junction) for junction in found])
    assert np.diff(np.sort(places[:, 0])).min() > 5


def test_masks_bounds_and_dem_leave_out__truth(flat):
    assert not junctions(flat, *CROSS, mask=shapely.box(WEST, NORTH - 1000, WEST + 900, NORTH))
    graph = planar_graph(roads_of(*CROSS))
    assert not find_junctions(
        graph, flat, sigmas_m=sigmas_m, bounds=(WEST, NORTH - 400, WEST + 900, NORTH)
    )
    beyond = [[(x + 2000, y) for x, y in line] for line in CROSS]
    assert not junctions(flat, *beyond)


def test_tracks_are_less_certain_than_roads__truth(flat):
    (paved,) = junctions(flat, *CROSS)
    (track,) = junctions(flat, *CROSS, layers=["Cesta", "Cesta"])
    (both,) = junctions(flat, *CROSS, kinds=["track", ""])
    assert paved.sigma_m[0] == pytest.approx(np.hypot(0.25, 0.3))
    assert track.sigma_m[0] == pytest.approx(np.hypot(0.25, 0.6))
    assert both.sigma_m[0] == paved.sigma_m[0]
    assert set(both.arm_kinds) == {"track", "roads"}


def test_no_roads_no_junctions__truth(flat):
    assert junctions(flat) == ()


def degrees_by_hand(lines) -> dict[tuple[float, float], int]:
    """Every crossing found pair by pair in whole numbers of a lattice, arms counted."""
    arms: dict[tuple[float, float], set] = {}
    for (x0, y0), (x1, y1) in lines:
        steps = max(abs(x1 - x0), abs(y1 - y0))
        path = [
            (x0 + (x1 - x0) * i // steps, y0 + (y1 - y0) * i // steps) for i in range(steps + 1)
        ]
        for one, other in pairwise(path):
            arms.setdefault(one, set()).add(other)
            arms.setdefault(other, set()).add(one)
    return {place: len(others) for place, others in arms.items() if len(others) >= 3}


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_degrees_agree_with_brute_force__oracle(seed):
    rng = np.random.default_rng(seed)
    lines = []
    for _ in range(12):
        at, length = rng.integers(0, 8, 2), int(rng.integers(1, 6))
        step = np.array([[1, 0], [0, 1]])[rng.integers(2)]
        lines.append((tuple(at.tolist()), tuple((at + length * step).tolist())))
    graph = planar_graph(roads_of(*[[(50 * x, 50 * y) for x, y in line] for line in lines]))
    meeting = graph.degrees >= 3
    places = np.round((graph.nodes - [WEST, NORTH - 1000]) / 50, 6)
    found = {
        tuple(place): int(degree)
        for place, degree in zip(places[meeting], graph.degrees[meeting], strict=True)
    }
    assert found == degrees_by_hand(lines)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_the_graph_does_not_hang_on_the_order_of_lines__law(seed):
    rng = np.random.default_rng(seed)
    lines = [rng.uniform(100, 900, (int(rng.integers(2, 5)), 2)) for _ in range(15)]
    one = planar_graph(roads_of(*lines))
    mixed = [lines[i][:: 1 if i % 2 else -1] for i in rng.permutation(15)]
    other = planar_graph(roads_of(*mixed))
    assert len(one.edges) == len(other.edges)
    np.testing.assert_allclose(np.sort(one.lengths), np.sort(other.lengths), atol=1e-6)
    # No two edges meet but in their ends.
    for i, edge in enumerate(one.edges):
        for later in one.edges[i + 1 :]:
            assert not edge.crosses(later)


def test_clusters_join_chains__law():
    points = np.array([[0, 0], [0.4, 0], [0.8, 0], [3, 3], [3.0, 3.3]])
    number = clusters(points, 0.5)
    assert len(set(number[:3])) == 1
    assert number[3] == number[4] != number[0]


def test_vovcha_junctions__real(shared_data):
    folder = shared_data / "vovcha-film"
    roads = read_roads(sorted((folder / "roads").glob("*.shp")), "EPSG:26918")
    dem = open_dem(folder / "dem.tif", "EPSG:26918")
    found = find_junctions(planar_graph(roads), dem, sigmas_m=sigmas_m)
    # 40 nodes of degree three and four of degree four; some of them lie beyond the DEM.
    assert len(found) == 36
    west, south, east, north = dem.bounds
    for junction in found:
        assert west <= junction.position[0] <= east
        assert south <= junction.position[1] <= north
        assert junction.degree >= 3
    assert len({junction.junction_id for junction in found}) == 36
