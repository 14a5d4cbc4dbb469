"""Meshes of the scene: read back by another program they are what was put in."""

import io

import numpy as np
import pytest
import trimesh

from tests.ui.desk_block import tiny_block
from ui.review.compare import DrawnPhoto
from ui.views.meshes import (
    TerrainOptions,
    hillshade_glb,
    needles_glb,
    relief_glb,
    shade_of,
    terrain_glb,
    veil_glb,
)

SEGMENTS = np.array([[[0.0, 0.0, 5.0], [1.0, 0.0, 5.0]], [[9.0, 9.0, 5.0], [9.0, 8.5, 5.0]]])
OPTIONS = TerrainOptions(vertices=40, texture_px=200)


def read(data: bytes) -> trimesh.Scene:
    return trimesh.load(io.BytesIO(data), file_type="glb", process=False, force="scene")


def test_needles_are_triangles_from_start_to_lengthened_end__oracle():
    colours = np.array([[76, 111, 216], [226, 0, 0]], dtype=np.uint8)
    (mesh,) = read(needles_glb(SEGMENTS, colours, 10.0, 0.4)).geometry.values()
    corners = mesh.vertices.reshape(-1, 3, 3)
    assert corners[:, 2] == pytest.approx(np.array([[10.0, 0.0, 5.0], [9.0, 4.0, 5.0]]))
    middle = corners[:, :2].mean(axis=1)
    assert middle == pytest.approx(SEGMENTS[:, 0])
    width = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
    assert width == pytest.approx([0.4, 0.4])
    given = mesh.visual.vertex_attributes["color"].reshape(2, 3, -1)[:, 0, :3]
    # The tone mapping of the browser shows a full channel as 226.
    assert given[1].tolist() == [255, 0, 0]
    assert given[0, 0] < given[0, 1] < given[0, 2]


def test_needles_of_no_length_are_no_needles_without_numbers__law():
    still, colours = np.zeros((1, 2, 3)), np.zeros((1, 3), dtype=np.uint8)
    (mesh,) = read(needles_glb(still, colours, 10.0, 0.4)).geometry.values()
    assert np.isfinite(mesh.vertices).all()


def test_the_drape_has_the_heights_of_the_ground__oracle():
    land, origin = tiny_block().land, tiny_block().block.origin
    bounds = land.today.bounds
    (mesh,) = read(terrain_glb(land.today, land.dem, bounds, origin, OPTIONS)).geometry.values()
    ground = mesh.vertices + origin
    assert np.abs(land.dem.heights(ground[:, :2]) - ground[:, 2]).max() < 0.01
    pixel = (bounds[2] - bounds[0]) / OPTIONS.vertices
    assert ground[:, 0].min() == pytest.approx(bounds[0], abs=pixel)
    assert ground[:, 1].max() == pytest.approx(bounds[3], abs=pixel)
    # All faces look up: a drape that looked down could not be clicked.
    assert (mesh.face_normals[:, 2] > 0).all()


def test_the_drape_has_no_faces_over_a_gap__law():
    land, origin = tiny_block().land, tiny_block().block.origin

    class Holed:
        def on(self, grid):
            heights = land.dem.on(grid)
            heights[5:10, 5:10] = np.nan
            return heights

    def faces(dem) -> int:
        data = terrain_glb(land.today, dem, land.today.bounds, origin, OPTIONS)
        return sum(len(mesh.faces) for mesh in read(data).geometry.values())

    assert faces(land.dem) - faces(Holed()) == 2 * 6 * 6


def test_slopes_to_the_light_are_white_and_those_away_from_it_black__truth():
    down, right = np.mgrid[0:8, 0:8].astype(float)
    level = shade_of(np.full((8, 8), 300.0), 5.0)
    assert (level[..., 3] == 0).all()
    # Rising to the south-east, a slope faces the light in the north-west.
    facing, turned = shade_of(2 * (down + right), 5.0), shade_of(-2 * (down + right), 5.0)
    assert (facing[..., 0] == 255).all()
    assert (turned[..., 0] == 0).all()
    assert min(facing[..., 3].min(), turned[..., 3].min()) > 30
    holed = np.where(down == 3, np.nan, 300.0)
    assert (shade_of(holed, 5.0)[..., 3] == 0).all()


def test_shade_lies_on_the_same_mesh_as_the_drape__law():
    land, origin = tiny_block().land, tiny_block().block.origin
    bounds = land.today.bounds
    drape = terrain_glb(land.today, land.dem, bounds, origin, OPTIONS)
    for made, mode in ((hillshade_glb, "BLEND"), (relief_glb, "OPAQUE")):
        shade = made(land.dem, bounds, origin, OPTIONS)
        (one,), (other,) = (read(data).geometry.values() for data in (drape, shade))
        assert (one.vertices == other.vertices).all()
        assert (one.faces == other.faces).all()
        assert other.visual.material.alphaMode == mode


def test_a_photo_laid_over_the_ground_is_where_its_rays_are__oracle():
    tiny = tiny_block()
    block, origin = tiny.block, tiny.block.origin
    name = "1938_01_015"
    photo, camera = block.photos[name], block.camera_of(name)
    grey = np.full((50, 50, 3), 90, dtype=np.uint8)
    data = veil_glb(
        grey, DrawnPhoto(photo, camera, 1), tiny.land.dem, origin, lift_m=8.0, options=OPTIONS
    )
    (mesh,) = read(data).geometry.values()
    used = np.unique(mesh.faces)
    vertices, places = mesh.vertices[used] + origin, mesh.visual.uv[used]
    film = (places - 0.5) * np.array(camera.frame_mm)
    seen = photo.pixel_from_object(vertices, camera)
    # Floating above the ground it is the same photo, seen from its centre.
    assert np.abs(seen - photo.interior.pixel_from_film(film)).max() < 0.3
    up = photo.exterior.centre - vertices
    ground = vertices - 8.0 / (up[:, 2:] + 8.0) * up
    assert np.abs(tiny.land.dem.heights(ground[:, :2]) - ground[:, 2]).max() < 1.0
    assert np.ptp(places, axis=0).min() > 0.9
    assert mesh.visual.material.baseColorFactor[3] < 255
