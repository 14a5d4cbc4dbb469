"""Tiny networks as ONNX files, written field by field (onnx.proto3 of ONNX)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

FLOAT = 1


def number(field: int, value: int) -> bytes:
    """A field that is a whole number."""
    return whole(field << 3) + whole(value)


def block(field: int, content: bytes | str) -> bytes:
    """A field of so many bytes."""
    inner = content.encode() if isinstance(content, str) else content
    return whole(field << 3 | 2) + whole(len(inner)) + inner


def whole(value: int) -> bytes:
    """A whole number, seven bits a byte."""
    out = b""
    while value > 0x7F:
        out, value = out + bytes([value & 0x7F | 0x80]), value >> 7
    return out + bytes([value])


def tensor(name: str, values: np.ndarray) -> bytes:
    """TensorProto of single precision."""
    dims = b"".join(number(1, side) for side in values.shape)
    raw = np.ascontiguousarray(values, "<f4").tobytes()
    return dims + number(2, FLOAT) + block(8, name) + block(9, raw)


def described(name: str, sides: Sequence[int | str]) -> bytes:
    """ValueInfoProto: sides are numbers or names."""
    dims = b"".join(
        block(1, number(1, side) if isinstance(side, int) else block(2, side)) for side in sides
    )
    return block(1, name) + block(2, block(1, number(1, FLOAT) + block(2, dims)))


def numbers(name: str, values: Sequence[int]) -> bytes:
    """AttributeProto of whole numbers."""
    return block(1, name) + b"".join(number(8, value) for value in values) + number(20, 7)


def write_convolution(file: Path, kernels: np.ndarray, stride: int = 1) -> Path:
    """A network of one convolution that keeps the size of its picture.

    Args:
        file: Where it goes.
        kernels: (channels, 1, side, side), the side odd.
        stride: More than one makes the picture smaller.
    """
    pad, side = kernels.shape[2] // 2, kernels.shape[2]
    attributes = (
        numbers("kernel_shape", [side, side]),
        numbers("pads", [pad] * 4),
        numbers("strides", [stride] * 2),
    )
    node = block(1, "grey") + block(1, "kernels") + block(2, "features") + block(3, "only")
    node += block(4, "Conv") + b"".join(block(5, one) for one in attributes)
    channels = kernels.shape[0]
    graph = block(1, node) + block(2, "net") + block(5, tensor("kernels", kernels))
    graph += block(11, described("grey", [1, 1, "rows", "columns"]))
    graph += block(12, described("features", [1, channels, "rows", "columns"]))
    file.write_bytes(number(1, 8) + block(7, graph) + block(8, block(1, "") + number(2, 13)))
    return file
