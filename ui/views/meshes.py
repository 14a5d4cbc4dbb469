"""Meshes of the scene as GLB: the DEM draped with the reference ortho, and needles for vectors."""

import io
import json
import struct
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import trimesh
from jaxtyping import Float64
from PIL import Image
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from core.arrays import Position
from core.raster.grid import Grid
from ui.review.looks import TIE_VECTOR, rgb
from ui.review.scene import Segments
from ui.review.tiles import Colour, OrthoSource, ortho_tile

SHOWN = (0, 14, 51, 141, 200, 226)
GIVEN = (0, 32, 64, 128, 192, 255)
"""Grey values the browser's tone mapping shows for those given (measured): undone beforehand."""
LEAST_M = 1e-6


class SurfaceSource(Protocol):
    """What the drape asks of a DEM."""

    def on(self, grid: Grid) -> Float64[np.ndarray, "rows columns"]:
        """Heights on a grid, metres; NaN in gaps."""
        ...


@dataclass(frozen=True, slots=True)
class TerrainOptions:
    """How fine the drape is."""

    vertices: int = 160
    """Vertices along the longer side."""
    texture_px: int = 1600
    """Pixels of the texture along the longer side."""
    jpeg_quality: int = 82
    """Of the texture."""


def terrain_glb(
    ortho: OrthoSource,
    dem: SurfaceSource,
    bounds: tuple[float, float, float, float],
    origin: Position,
    options: TerrainOptions,
) -> bytes:
    """The drape over bounds (west, south, east, north), in the local frame."""
    longer = max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    nodes = Grid.over(bounds, longer / options.vertices)
    heights = dem.on(nodes)
    eastings, northings = nodes.centres()
    across, down = np.meshgrid(eastings, northings)
    sound = np.isfinite(heights)
    level = float(np.median(heights[sound])) if sound.any() else 0.0
    vertices = np.column_stack(
        [across.ravel(), down.ravel(), np.where(sound, heights, level).ravel()]
    )
    west, south, east, north = nodes.bounds
    texture_from = np.column_stack(
        [(across.ravel() - west) / (east - west), (down.ravel() - south) / (north - south)]
    )
    picture = ortho_tile(ortho, Grid.over(nodes.bounds, longer / options.texture_px))
    material = PBRMaterial(
        baseColorTexture=_as_jpeg(picture, options.jpeg_quality),
        metallicFactor=0.0,
        roughnessFactor=1.0,
    )
    mesh = trimesh.Trimesh(
        vertices=vertices - origin,
        faces=_faces(sound),
        visual=TextureVisuals(uv=texture_from, material=material),
        process=False,
    )
    data = export_glb(mesh, include_normals=False, tree_postprocessor=_unlit)
    assert isinstance(data, bytes)
    return data


def _faces(sound: np.ndarray) -> np.ndarray:
    """Two triangles for every cell whose four corners have a height."""
    rows, columns = sound.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    whole = sound[:-1, :-1] & sound[1:, :-1] & sound[:-1, 1:] & sound[1:, 1:]
    if not whole.any():
        whole = np.ones_like(whole)
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    north_west, south_west, south_east, north_east = (corner[whole] for corner in corners)
    return np.vstack(
        [
            np.column_stack([north_west, south_west, south_east]),
            np.column_stack([north_west, south_east, north_east]),
        ]
    )


def _as_jpeg(picture: Colour, quality: int) -> Image.Image:
    """The texture as a JPEG that trimesh embeds as it is, against the browser's tone mapping."""
    table = np.interp(np.arange(256), SHOWN, GIVEN).round().astype(np.uint8)
    memory = io.BytesIO()
    Image.fromarray(table[picture]).save(memory, format="JPEG", quality=quality)
    memory.seek(0)
    return Image.open(memory)


def _unlit(tree: dict[str, Any]) -> None:
    """No lights: the texture as it is, and 2.8 times as fast in software."""
    tree["extensionsUsed"] = [*tree.get("extensionsUsed", []), "KHR_materials_unlit"]
    for material in tree["materials"]:
        material.setdefault("extensions", {})["KHR_materials_unlit"] = {}
        material["doubleSided"] = True


def needles_glb(segments: Segments, scale: float, width_m: float, lift: Position) -> bytes:
    """A GLB with one triangle for each vector: broad at the start, a tip at the end.

    Args:
        segments: Start and end of each vector, local frame, metres, (n, 2, 3).
        scale: How many times longer than life they are drawn.
        width_m: Width at the start, metres.
        lift: Added to every place.
    """
    start, end = segments[:, 0], segments[:, 1]
    tip = start + (end - start) * scale
    along = tip[:, :2] - start[:, :2]
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), LEAST_M)
    across = np.column_stack([-along[:, 1:], along[:, :1]]) / length * width_m / 2
    beside = np.column_stack([across, np.zeros(len(across))])
    corners = np.stack([start - beside, start + beside, tip], axis=1) + lift
    return _glb(corners.reshape(-1, 3).astype("<f4"))


def _glb(vertices: np.ndarray) -> bytes:
    """Plain triangles of one colour without lights, as binary glTF 2.0."""
    red, green, blue = (channel / 255 for channel in rgb(TIE_VECTOR))
    data = vertices.tobytes()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    tree = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0, "mode": 4}]}],
        "materials": [{
            "pbrMetallicRoughness": {"baseColorFactor": [red, green, blue, 1.0],
                                     "metallicFactor": 0.0, "roughnessFactor": 1.0},
            "doubleSided": True, "extensions": {"KHR_materials_unlit": {}},
        }],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data), "target": 34962}],
        "accessors": [{
            "bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3",
            "min": low.tolist(), "max": high.tolist(),
        }],
    }  # fmt: skip
    head = json.dumps(tree, separators=(",", ":")).encode()
    head += b" " * (-len(head) % 4)
    total = 12 + 8 + len(head) + 8 + len(data)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, total),
            struct.pack("<I4s", len(head), b"JSON"),
            head,
            struct.pack("<I4s", len(data), b"BIN\0"),
            data,
        ]
    )
