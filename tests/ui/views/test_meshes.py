"""Meshes of the scene: read back by another program they are what was put in."""

import io

import numpy as np
import pytest
import trimesh

from tests.ui.desk_block import tiny_block
from ui.views.meshes import TerrainOptions, needles_glb, terrain_glb

SEGMENTS = np.array([[[0.0, 0.0, 5.0], [1.0, 0.0, 5.0]], [[9.0, 9.0, 5.0], [9.0, 8.5, 5.0]]])
OPTIONS = TerrainOptions(vertices=40, texture_px=200)


def read(data: bytes) -> trimesh.Scene:
    return trimesh.load(io.BytesIO(data), file_type="glb", process=False, force="scene")


def test_needles_are_triangles_from_start_to_lengthened_end__oracle():
    lift = np.array([0.0, 0.0, 2.0])
    (mesh,) = read(needles_glb(SEGMENTS, 10.0, 0.4, lift)).geometry.values()
    corners = mesh.vertices.reshape(-1, 3, 3)
    assert corners[:, 2] == pytest.approx(np.array([[10.0, 0.0, 7.0], [9.0, 4.0, 7.0]]))
    middle = corners[:, :2].mean(axis=1)
    assert middle == pytest.approx(SEGMENTS[:, 0] + lift)
    width = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
    assert width == pytest.approx([0.4, 0.4])


def test_needles_of_no_length_are_no_needles_without_numbers__law():
    still = np.zeros((1, 2, 3))
    (mesh,) = read(needles_glb(still, 10.0, 0.4, np.zeros(3))).geometry.values()
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
