"""The 3D view: what a seat switches off is hidden, and nothing is sent twice."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from tests.ui.desk_block import outlines, tiny_block, tiny_snapshot
from ui.review.looks import CHOSEN as CHOSEN_COLOUR
from ui.review.looks import CURRENT as CURRENT_COLOUR
from ui.review.looks import LIGHT, LOOKS, PHOTO, STALE, rgb
from ui.review.scene import scene_picture, short_names
from ui.review.state import SceneOptions
from ui.views.block_view import (
    AREAS,
    CHOSEN,
    CURRENT,
    CURRENT_RAY,
    ELLIPSES,
    FOOTPRINTS,
    HILLSHADE,
    OTHERS,
    SPECIALS,
    TERRAIN,
    TIES,
    VECTORS,
    VEIL,
    BlockView,
    Pointed,
    Stage,
    photo_node,
    points_node,
)
from ui.views.labels import label_node

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
    picture = scene_picture(state, ("1938_01_014",), outlines(state), tiny_block().land.dem)
    client = MagicMock(scene=Scene())
    client.camera.aspect = 1.5
    client.camera.fov = 0.8
    view = BlockView(client, Stage(2400.0, np.zeros(3)), picture)
    view.show(picture, ALL, None)
    return view, picture, client


def test_every_photo_and_every_state_has_a_node__law(shown):
    _, picture, client = shown
    nodes = client.scene.nodes
    assert {photo_node(one.photo_id) for one in picture.frustums} <= set(nodes)
    assert {points_node(state) for state in LOOKS} <= set(nodes)
    # Photos alone have names there, without what all of them share: points had 426 of them.
    told = {name for name in nodes if name.startswith("/labels/")}
    assert told == {label_node(name) for name in picture.labels}
    assert set(picture.labels) == set(short_names(list(tiny_block().block.photos)).values())
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


def test_photos_and_the_ray_are_drawn_for_a_light_ground__law(shown):
    view, picture, client = shown
    nodes, seen = client.scene.nodes, {}
    for light in (True, False):
        view.show(picture, replace(ALL, light=light, photo="1938_01_016"), None)
        photos = (nodes[photo_node(f"1938_01_01{number}")].color for number in (4, 5, 6))
        lines = (tuple(nodes[name].colors) for name in (CHOSEN, CURRENT_RAY))
        seen[light] = [*photos, *lines]
    dark = [STALE, PHOTO, CHOSEN_COLOUR, CHOSEN_COLOUR, CURRENT_COLOUR]
    assert seen == {False: [*map(rgb, dark)], True: [rgb(LIGHT[colour]) for colour in dark]}


def test_what_is_current_is_ringed__truth(shown):
    view, picture, client = shown
    assert not client.scene.nodes[CURRENT].visible
    place = np.array([10.0, 20.0, 30.0])
    view.show(picture, ALL, Pointed(place, place + np.array([0.0, 0.0, 900.0])))
    ring = client.scene.nodes[CURRENT]
    assert ring.visible
    middle = np.asarray(ring.points)[:, 0].mean(axis=0)
    assert middle[:2] == pytest.approx(place[:2], abs=0.01)
    view.show(picture, ALL, None)
    assert not ring.visible


def test_longer_misfits_have_other_colours__truth(shown):
    _, picture, client = shown
    nodes = client.scene.nodes
    sizes = np.linalg.norm(picture.vectors[:, 1] - picture.vectors[:, 0], axis=1)
    colours = np.asarray(nodes[VECTORS].colors)[:, 0]
    assert len(np.unique(colours, axis=0)) > 3
    assert (colours[np.argmin(sizes)] != colours[np.argmax(sizes)]).any()


def test_the_whole_block_fills_a_window_of_any_shape__law(shown):
    view, picture, client = shown
    camera = client.camera
    view.fit(None)
    for window in (0.7, 1.6):
        camera.aspect = window  # of another shape than the eye was set for
        arrived, camera.position = camera.position, (0.0, 0.0, 1.0)
        view.fit_again()  # somebody looks elsewhere
        assert tuple(camera.position) == (0.0, 0.0, 1.0)
        # As a browser tells it.
        camera.position = np.asarray(arrived, np.float32) + np.float32(1e-3)
        assert view.is_outgrown
        view.fit_again()
        assert not view.is_outgrown
        centres = np.array([one.centre for one in picture.frustums])
        places = np.vstack((picture.footprints.reshape(-1, 3), centres)) - camera.position
        ahead = np.asarray(camera.look_at) - camera.position
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, camera.up_direction)
        right /= np.linalg.norm(right)
        frame = np.column_stack((right, np.cross(right, ahead)))
        half = np.tan(camera.fov / 2) * np.array([window, 1.0])
        shares = places @ frame / (places @ ahead)[:, None] / half
        widest = np.abs(shares).max(axis=0)
        assert (widest < 0.85).all()  # the tools lie at the rims
        assert widest.max() > 0.75
        assert shares[:, 0].max() == pytest.approx(-shares[:, 0].min(), abs=0.05)  # in the middle


def test_the_chosen_photo_stands_out_with_its_points__law(shown):
    view, picture, client = shown
    nodes, name = client.scene.nodes, "1938_01_015"
    assert not nodes[CHOSEN].visible
    everything = sum(len(cloud.points) for cloud in picture.points.values())
    view.show(picture, replace(ALL, photo=name), None)
    assert nodes[CHOSEN].visible
    assert nodes[photo_node(name)].color == rgb(CHOSEN_COLOUR)
    own = [len(cloud.shown_in(name)) for cloud in picture.points.values()]
    clouds = [nodes[points_node(state)] for state in LOOKS]
    assert own == [len(cloud.points) if cloud.visible else 0 for cloud in clouds]
    checks = len(picture.checks.points) - len(picture.checks.shown_in(name))
    assert len(nodes[OTHERS].points) == everything - sum(own) + checks
    assert len(nodes[VECTORS].points) == sum(key[1] == name for key in picture.vector_keys)
    view.show(picture, ALL, None)
    assert not nodes[OTHERS].visible
    assert len(nodes[VECTORS].points) == len(picture.vectors)


def test_heights_are_drawn_larger_about_the_level_of_the_ground__law(shown):
    view, picture, client = shown
    nodes = client.scene.nodes
    flat = np.asarray(nodes[TIES].points)[:, 2].copy()
    view.lay(TERRAIN, b"glb")
    view.show(picture, replace(ALL, relief=5.0), None)
    steep = np.asarray(nodes[TIES].points)[:, 2]
    lift = flat[0] - picture.ties.points[0, 2]
    assert steep - lift - picture.level_m == pytest.approx(
        5 * (flat - lift - picture.level_m), abs=0.01
    )
    drape = nodes[TERRAIN]
    assert drape.scale == (1.0, 1.0, 5.0)
    # The level itself stays where it is.
    assert drape.position[2] + 5 * picture.level_m == pytest.approx(picture.level_m)


def test_ties_of_so_many_photos_are_shown_alone__law(shown):
    view, picture, client = shown
    for rays in np.unique(picture.rays):
        view.show(picture, replace(ALL, rays=int(rays)), None)
        drawn = client.scene.nodes[TIES]
        assert drawn.visible
        assert len(drawn.points) == np.count_nonzero(picture.rays == rays)


def test_ties_are_coloured_by_their_rays__law(shown):
    _, picture, client = shown
    colours = np.asarray(client.scene.nodes[TIES].colors)
    assert len(colours) == len(picture.ties.points)
    for rays in np.unique(picture.rays):
        assert len(np.unique(colours[picture.rays == rays], axis=0)) == 1
    assert len(np.unique(colours, axis=0)) == len(np.unique(np.minimum(picture.rays, 6)))


def test_shade_areas_and_ellipses_are_shown_when_asked_for__law(shown):
    view, picture, client = shown
    nodes = client.scene.nodes
    view.lay(HILLSHADE, b"shade")
    assert nodes[HILLSHADE].visible
    assert nodes[ELLIPSES].visible
    view.show(picture, SceneOptions(), None)
    assert not nodes[HILLSHADE].visible
    assert not nodes[ELLIPSES].visible
    assert AREAS not in nodes or not nodes[AREAS].visible


def test_the_eye_flies_into_a_photo_and_back_to_where_it_was__law(shown):
    view, picture, client = shown
    camera = client.camera
    before = np.asarray(camera.position).copy()
    view.lay(VEIL, b"veil")
    assert not client.scene.nodes[VEIL].visible
    view.show(picture, replace(ALL, inside="1938_01_015"), None)
    assert client.scene.nodes[VEIL].visible
    while view.fly_on():
        pass
    frustum = next(one for one in picture.frustums if one.photo_id == "1938_01_015")
    assert np.asarray(camera.position) == pytest.approx(frustum.centre)
    assert not any(client.scene.nodes[photo_node(one.photo_id)].visible for one in picture.frustums)
    opening, camera.aspect = camera.fov, 0.6
    view.seen_from(1650.0, 1.0)
    assert camera.fov > opening
    view.show(picture, ALL, None)
    while view.fly_on():
        pass
    assert np.asarray(camera.position) == pytest.approx(before)
    assert client.scene.nodes[photo_node("1938_01_015")].visible


def test_the_plumb_line_of_the_chosen_photo_is_drawn_with_its_letters__truth(shown):
    view, picture, client = shown
    nodes, name = client.scene.nodes, "1938_01_015"
    assert not nodes[SPECIALS].visible, "no photo is chosen, and none looked at"
    view.seen_from(100.0, 0.01)
    view.show(picture, replace(ALL, photo=name), None)
    centre = next(one.centre for one in picture.frustums if one.photo_id == name)
    lines = nodes[SPECIALS].points
    assert nodes[SPECIALS].visible
    assert lines[:, 1] == pytest.approx(np.tile(centre, (3, 1)), abs=0.01)
    assert {one for one in nodes if one.startswith("/specials/")} == {
        label_node(letter, SPECIALS) for letter in "NIH"
    }
    below = nodes[label_node("N", SPECIALS)].position
    assert below[:2] == pytest.approx(centre[:2], abs=0.02)
    # From afar the letters would lie over each other.
    view.seen_from(4000.0, 20.0)
    assert nodes["/specials/N"].visible is False
    (together,) = (one for one in nodes if one.startswith("/specials/") and " " in one)
    assert nodes[together].visible
    view.show(picture, replace(ALL, photo=name, hidden=frozenset({"specials"})), None)
    assert not nodes[SPECIALS].visible
    assert not nodes[together].visible
    # Without a chosen photo it is the one that is looked at.
    view.show(picture, ALL, Pointed(np.zeros(3), centre, name))
    assert nodes[SPECIALS].visible
