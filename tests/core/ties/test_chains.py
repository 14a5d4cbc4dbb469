"""Chains: one ground detail, one place per photo."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from core.block import TiePoints
from core.ties.chains import common_rays, join_matches, rays_per_point, with_rays

OWNERS = st.lists(st.integers(0, 4), min_size=2, max_size=25)


@st.composite
def graphs(draw):
    owner = draw(OWNERS)
    node = st.integers(0, len(owner) - 1)
    edges = draw(st.lists(st.tuples(node, node), max_size=40))
    return np.array(owner), np.array(
        [edge for edge in edges if owner[edge[0]] != owner[edge[1]]], dtype=np.int64
    ).reshape(-1, 2)


@settings(max_examples=200)
@given(graphs())
def test_no_point_has_two_places_in_a_photo__law(graph):
    owner, edges = graph
    roots = join_matches(edges, owner)
    for root in np.unique(roots):
        photos = owner[roots == root]
        assert len(np.unique(photos)) == len(photos)


@settings(max_examples=200)
@given(graphs())
def test_points_hang_together_and_only_conflicts_part_them__law(graph):
    owner, edges = graph
    roots = join_matches(edges, owner)
    for one, other in edges.tolist():
        if roots[one] != roots[other]:
            both = np.concatenate([owner[roots == roots[one]], owner[roots == roots[other]]])
            assert len(np.unique(both)) < len(both)
    for root in np.unique(roots):
        members = set(np.flatnonzero(roots == root).tolist())
        reached = {min(members)}
        for _ in range(len(members)):
            for one, other in edges.tolist():
                if one in members and other in members and {one, other} & reached:
                    reached |= {one, other}
        assert reached == members


def test_the_more_distinct_match_wins_a_conflict__truth():
    roots = join_matches(np.array([[0, 2], [1, 2]]), np.array([0, 0, 1]))
    assert roots[0] == roots[2] != roots[1]


def test_points_with_one_ray_go_and_the_rest_is_renumbered__truth():
    ties = TiePoints(
        ("a", "b", "c"),
        np.array([0, 0, 1, 1, 1, 2, 2]),
        np.array([1, 0, 0, 1, 2, 0, 2]),
        np.arange(14.0).reshape(7, 2),
        np.ones(7),
    )
    left = with_rays(ties, np.array([True, False, True, False, True, True, True]))
    assert left.point.tolist() == [0, 0, 1, 1]
    assert left.photo.tolist() == [0, 2, 0, 2]
    assert rays_per_point(left).tolist() == [2, 2]
    assert left.pixels[:, 0].tolist() == [4.0, 8.0, 10.0, 12.0]
    assert with_rays(left, np.zeros(4, dtype=bool)).count == 0


def test_common_rays_are_those_of_the_same_points__truth():
    ties = TiePoints(
        ("a", "b"),
        np.array([0, 0, 1, 1, 2, 2]),
        np.array([0, 1, 1, 0, 0, 1]),
        np.zeros((6, 2)),
        np.ones(6),
    )
    ours, theirs = common_rays(ties, 0, 1)
    assert ours.tolist() == [0, 3, 4]
    assert theirs.tolist() == [1, 2, 5]
