"""The 3D view: what a seat switches off is hidden, and nothing is sent twice."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from tests.ui.desk_block import outlines, tiny_snapshot
from ui.review.looks import LOOKS, STALE, rgb
from ui.review.scene import measure_m, scene_picture
from ui.review.state import SceneOptions
from ui.views.block_view import (
    CURRENT,
    CURRENT_NAME,
    FOOTPRINTS,
    MEASURE,
    MEASURE_NAME,
    VECTORS,
    BlockView,
    Pointed,
    Stage,
    label_node,
    photo_node,
    points_node,
)

ALL = SceneOptions(hidden=frozenset(), vector_scale=5.0)


class Scene:
    """Remembers the nodes that viser would send."""

    def __init__(self):
        self.nodes: dict[str, SimpleNamespace] = {}

    def __getattr__(self, name):
        def add(node, *arguments, **options):
            points = arguments[0] if arguments else None
            given = {"points": points, "visible": True, "remove": lambda: None}
            made = SimpleNamespace(**{**given, **options})
            self.nodes[node] = made
            return made

        return add


@pytest.fixture
def shown():
    state = tiny_snapshot().state
    picture = scene_picture(state, ("1938_01_014",), outlines(state))
    client = MagicMock(scene=Scene())
    client.camera.aspect = 1.5
    view = BlockView(client, Stage(2400.0, np.zeros(3)), picture)
    view.show(picture, ALL, None)
    return view, picture, client


def test_every_photo_and_every_state_has_a_node__law(shown):
    _, picture, client = shown
    nodes = client.scene.nodes
    assert {photo_node(one.photo_id) for one in picture.frustums} <= set(nodes)
    assert {points_node(state) for state in LOOKS} <= set(nodes)
    assert {label_node(name) for name in picture.labels} <= set(nodes)
    assert label_node("a/b") == "/labels/a_b"


def test_a_layer_switched_off_is_hidden__law(shown):
    view, picture, client = shown
    nodes = client.scene.nodes
    assert nodes[FOOTPRINTS].visible
    hidden = frozenset({"footprints", "photos", "points", "labels", "vectors"})
    view.show(picture, replace(ALL, hidden=hidden), None)
    names = [FOOTPRINTS, VECTORS, photo_node(picture.frustums[0].photo_id), points_node("auto"),
             label_node(next(iter(picture.labels)))]  # fmt: skip
    assert not any(nodes[name].visible for name in names)


def test_vectors_are_as_many_times_longer_as_the_slider_says__truth(shown):
    _, picture, client = shown
    drawn = np.asarray(client.scene.nodes[VECTORS].points)
    lengths = np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1)
    own = np.linalg.norm(picture.vectors[:, 1] - picture.vectors[:, 0], axis=1)
    assert lengths == pytest.approx(5 * own, rel=1e-3, abs=1e-3)


def test_a_stale_photo_has_the_colour_of_stale_ones__law(shown):
    _, _, client = shown
    nodes = client.scene.nodes
    assert nodes[photo_node("1938_01_014")].color == rgb(STALE)
    assert nodes[photo_node("1938_01_015")].color != rgb(STALE)


def test_what_is_current_is_ringed__truth(shown):
    view, picture, client = shown
    assert not client.scene.nodes[CURRENT].visible
    place = np.array([10.0, 20.0, 30.0])
    view.show(picture, ALL, Pointed("J-1", place, place + np.array([0.0, 0.0, 900.0])))
    ring = client.scene.nodes[CURRENT]
    assert ring.visible
    middle = np.asarray(ring.points)[:, 0].mean(axis=0)
    assert middle[:2] == pytest.approx(place[:2], abs=0.01)
    assert client.scene.nodes[CURRENT_NAME].visible
    view.show(picture, ALL, None)
    assert not client.scene.nodes[CURRENT_NAME].visible


def test_longer_misfits_have_other_colours_and_an_arrow_tells_their_scale__truth(shown):
    _, picture, client = shown
    nodes = client.scene.nodes
    sizes = np.linalg.norm(picture.vectors[:, 1] - picture.vectors[:, 0], axis=1)
    colours = np.asarray(nodes[VECTORS].colors)[:, 0]
    assert len(np.unique(colours, axis=0)) > 3
    assert (colours[np.argmin(sizes)] != colours[np.argmax(sizes)]).any()
    arrow = np.asarray(nodes[MEASURE].points)[0]
    length = measure_m(2400.0, ALL.vector_scale)
    assert np.linalg.norm(arrow[1] - arrow[0]) == pytest.approx(5 * length, rel=1e-3)
    assert nodes[MEASURE_NAME].visible


def test_the_eye_is_set_so_that_the_whole_block_is_in_sight__law(shown):
    view, _, client = shown
    view.fit(None)
    away = np.linalg.norm(np.asarray(client.camera.position) - np.asarray(client.camera.look_at))
    assert 2 * away * np.tan(client.camera.fov / 2) > 2400.0
