"""Vectors of very many points as one mesh: a flat needle each, which browsers draw at once.

Lines with a width of their own cost the browser a solid each; a hundred thousand of them took
15 s with software rendering, as triangles of one mesh they are there in a fraction of it.
"""

import json
import struct

import numpy as np

from core.arrays import Position
from ui.review.palette import TIE_VECTOR, rgb
from ui.review.scene import Segments

LEAST_M = 1e-6


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
