"""Meshes of the scene as GLB: the DEM draped with ortho, shade or a photo; residual needles."""

import io
import json
import struct
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import trimesh
from jaxtyping import Bool, Float64, UInt8
from PIL import Image
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from core.arrays import Position
from core.block import footprint
from core.geometry.crs import Bounds
from core.raster.grid import Grid
from ui.review import looks
from ui.review.compare import DrawnPhoto
from ui.review.scene import Segments
from ui.review.tiles import Colour, OrthoSource, ortho_tile

SHOWN = (0, 14, 51, 141, 200, 226)
GIVEN = (0, 32, 64, 128, 192, 255)
"""Grey values the browser's tone mapping shows for those given (measured): undone beforehand."""
LEAST_M = 1e-6
SUN = np.array([-1.0, 1.0, 1.4]) / np.linalg.norm([-1.0, 1.0, 1.4])
"""Towards the light of the shaded relief: from the north-west, as maps have it."""
BARE = 150
"""Grey of level ground without the ortho, of 255."""
SHADE = 0.75
"""How dense the shade is at most."""
VEIL = 140
"""How dense a photo lies over the terrain, of 255."""
CLAMPED = 33071
"""Textures of glTF go on with the colour of their edge."""


Colours = UInt8[np.ndarray, "rows columns 4"]


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

    shade_px: int = 640
    """Pixels of the shaded relief along the longer side."""
    photo_px: int = 1400
    """Pixels of a photo laid over the terrain, along its side."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A part of the ground as a mesh, and where on a picture of it each vertex lies."""

    vertices: Float64[np.ndarray, "n 3"]
    """Places, local frame, metres."""
    sound: Bool[np.ndarray, "rows columns"]
    """Which of them have a height."""
    places: Float64[np.ndarray, "n 2"]
    """On the picture, right and up, 0 to 1."""
    bounds: Bounds
    """West, south, east, north of the picture."""


def sheet_over(
    dem: SurfaceSource, bounds: Bounds, origin: Position, options: TerrainOptions
) -> Sheet:
    """The ground over bounds (west, south, east, north), in the local frame."""
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
    places = (vertices[:, :2] - (west, south)) / (east - west, north - south)
    return Sheet(vertices - origin, sound, places, nodes.bounds)


def terrain_glb(
    ortho: OrthoSource,
    dem: SurfaceSource,
    bounds: Bounds,
    origin: Position,
    options: TerrainOptions,
) -> bytes:
    """The drape over bounds (west, south, east, north), in the local frame."""
    sheet = sheet_over(dem, bounds, origin, options)
    longer = max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    picture = ortho_tile(ortho, Grid.over(sheet.bounds, longer / options.texture_px))
    return _sheet_glb(sheet, _as_jpeg(picture, options.jpeg_quality))


def relief_glb(
    dem: SurfaceSource, bounds: Bounds, origin: Position, options: TerrainOptions
) -> bytes:
    """The bare relief in the light: the ground of the scene until the ortho is read."""
    sheet = sheet_over(dem, bounds, origin, options)
    shade = _shade_over(sheet, dem, options).astype(np.float64)
    density = shade[..., 3:] / 255
    picture = np.rint(shade[..., :3] * density + BARE * (1 - density)).astype(np.uint8)
    return _sheet_glb(sheet, _as_jpeg(picture, options.jpeg_quality))


def hillshade_glb(
    dem: SurfaceSource, bounds: Bounds, origin: Position, options: TerrainOptions
) -> bytes:
    """The shade of the relief, clear where the ground is level: to be seen over the drape.

    Its mesh is that of the drape, so that neither hides the other.
    """
    sheet = sheet_over(dem, bounds, origin, options)
    return _sheet_glb(sheet, _as_png(_shade_over(sheet, dem, options)))


def _shade_over(sheet: Sheet, dem: SurfaceSource, options: TerrainOptions) -> Colours:
    """Its light and shadow."""
    west, south, east, north = sheet.bounds
    grid = Grid.over(sheet.bounds, max(east - west, north - south) / options.shade_px)
    return shade_of(dem.on(grid), grid.ground_sample_distance_m)


def shade_of(heights: Float64[np.ndarray, "rows columns"], pixel_m: float) -> Colours:
    """Light and shadow (red, green, blue, density) of heights; clear on level ground and in gaps.

    Args:
        heights: Metres, north row first.
        pixel_m: Their distance, metres.
    """
    down, right = np.gradient(heights, pixel_m)
    normal = np.stack([-right, down, np.ones_like(heights)], axis=2)
    light = np.nan_to_num(normal @ SUN / np.linalg.norm(normal, axis=2), nan=SUN[2])
    # Against level ground: black where less light falls, white where more does.
    dark, bright = 1 - light / SUN[2], (light - SUN[2]) / (1 - SUN[2])
    density = SHADE * np.where(dark > 0, np.clip(dark, 0, 1), np.clip(bright, 0, 1))
    shade = np.zeros((*heights.shape, 4), dtype=np.uint8)
    shade[..., :3] = np.where(dark > 0, 0, 255)[..., None]
    shade[..., 3] = np.rint(255 * density)
    return shade


def veil_glb(
    picture: Colour, drawn: DrawnPhoto, dem: SurfaceSource, origin: Position, *,
    lift_m: float, options: TerrainOptions,
) -> bytes:  # fmt: skip
    """A photo half transparent over the terrain.

    Args:
        picture: Its picture area, upright in the film frame.
        drawn: The photo and its camera.
        dem: Heights.
        origin: Of the local frame.
        lift_m: It floats so far above the terrain, along its rays, so that from its perspective
            centre it fits all the same.
        options: How fine it is.
    """
    photo, camera = drawn.photo, drawn.camera
    bounds = footprint(photo, camera).bounds
    room = 0.1 * max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    wide = (bounds[0] - room, bounds[1] - room, bounds[2] + room, bounds[3] + room)
    sheet = sheet_over(dem, wide, origin, options)
    ground = sheet.vertices + origin
    film = photo.interior.film_from_pixel(photo.pixel_from_object(ground, camera))
    places = film / np.array(camera.frame_mm) + 0.5
    within = (np.abs(places - 0.5) <= 0.5).all(axis=1).reshape(sheet.sound.shape)
    up = photo.exterior.centre - ground
    floating = ground + lift_m / np.maximum(up[:, 2:], lift_m) * up - origin
    laid = Sheet(floating, sheet.sound & within, places, sheet.bounds)
    return _sheet_glb(laid, _as_jpeg(picture, options.jpeg_quality), VEIL)


def _sheet_glb(sheet: Sheet, texture: Image.Image, density: int = 255) -> bytes:
    """A textured mesh without lights."""
    clear = density < 255 or texture.mode == "RGBA"
    material = PBRMaterial(
        baseColorTexture=texture,
        baseColorFactor=[255, 255, 255, density],
        alphaMode="BLEND" if clear else "OPAQUE",
        metallicFactor=0.0,
        roughnessFactor=1.0,
    )
    mesh = trimesh.Trimesh(
        vertices=sheet.vertices,
        faces=_faces(sheet.sound),
        visual=TextureVisuals(uv=sheet.places, material=material),
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


def _as_png(picture: Colours) -> Image.Image:
    """The texture as a PNG that trimesh embeds as it is."""
    memory = io.BytesIO()
    Image.fromarray(picture).save(memory, format="PNG")
    memory.seek(0)
    return Image.open(memory)


def _unlit(tree: dict[str, Any]) -> None:
    """No lights: the texture as it is, and 2.8 times as fast in software."""
    tree["extensionsUsed"] = [*tree.get("extensionsUsed", []), "KHR_materials_unlit"]
    for material in tree["materials"]:
        material.setdefault("extensions", {})["KHR_materials_unlit"] = {}
        material["doubleSided"] = True
    tree["samplers"] = [{"wrapS": CLAMPED, "wrapT": CLAMPED}]
    for texture in tree["textures"]:
        texture["sampler"] = 0


def needles_glb(segments: Segments, colours: looks.Colours, scale: float, width_m: float) -> bytes:
    """A GLB with one triangle for each vector: broad at the start, a tip at the end.

    Args:
        segments: Start and end of each vector, local frame, metres, (n, 2, 3).
        colours: How each is to be seen.
        scale: How many times longer than life they are drawn.
        width_m: Width at the start, metres.
    """
    start, end = segments[:, 0], segments[:, 1]
    tip = start + (end - start) * scale
    along = tip[:, :2] - start[:, :2]
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), LEAST_M)
    across = np.column_stack([-along[:, 1:], along[:, :1]]) / length * width_m / 2
    beside = np.column_stack([across, np.zeros(len(across))])
    corners = np.stack([start - beside, start + beside, tip], axis=1)
    # Undone beforehand: the tone mapping, then the curve of sRGB that glTF takes colours without.
    linear = (np.interp(colours, SHOWN, GIVEN) / 255) ** 2.2
    vertices = np.zeros(3 * len(corners), dtype=[("place", "<f4", 3), ("colour", "u1", 4)])
    vertices["place"] = corners.reshape(-1, 3)
    vertices["colour"][:, :3] = np.repeat(np.rint(255 * linear), 3, axis=0)
    vertices["colour"][:, 3] = 255
    return _glb(vertices)


def _glb(vertices: np.ndarray) -> bytes:
    """Plain triangles without lights, a colour at each corner, as binary glTF 2.0."""
    data, places = vertices.tobytes(), vertices["place"]
    whole = {"bufferView": 0, "count": len(vertices)}
    tree = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0, "COLOR_0": 1}, "material": 0, "mode": 4}
        ]}],
        "materials": [{
            "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
            "doubleSided": True, "extensions": {"KHR_materials_unlit": {}},
        }],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{
            "buffer": 0, "byteLength": len(data), "byteStride": vertices.itemsize, "target": 34962,
        }],
        "accessors": [
            {
                **whole, "componentType": 5126, "type": "VEC3",
                "min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist(),
            },
            {**whole, "componentType": 5121, "normalized": True, "type": "VEC4",
             "byteOffset": places.itemsize * 3},
        ],
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
