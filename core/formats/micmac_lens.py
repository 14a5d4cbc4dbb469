"""MicMac's central projection, exactly, and as a camera of the exchanged block.

A ray (x / z, y / z) of the camera (x right, y down, z forwards) comes to PP + F (x / z, y / z), and
is moved by a polynomial of the distance from CDist, by P1 and P2, and in x by b1 x + b2 y, all of
the ideal place (FORMATS 4.21). MMVII has the same terms, in units of F.
"""

from dataclasses import dataclass, replace

import numpy as np

from core.arrays import Affine2, FilmPoints, Matrix, PixelPoints
from core.formats.exchange import (
    ROUNDS,
    SETTLED,
    ExchangeCamera,
    FrameCamera,
    Pair,
    image_from_ideal,
)
from core.frames import HALF_PIXEL

# source: definition of the two frames; MicMac's y points down.
DOWN = np.array([1.0, -1.0])
"""Image coordinates with y up from rays with y down, and back."""
# design: the corners and enough between to see a polynomial of degree eleven.
NODES = 21
"""Rows and columns of the grid over which a lens is fitted."""
# design: Newton's steps double the digits; six bring any double to rest.
STEPS = 6
"""Steps of the fit."""
# design: MicMac itself uses five at most, and doubles hold no more.
FITTED = 5
"""Radial terms of a lens that is fitted."""


@dataclass(frozen=True, slots=True)
class MicmacLens:
    """A calibration as the file has it, in its own unit (millimetres or pixels)."""

    focal: float
    """F."""
    principal_point: Pair
    """PP."""
    centre: Pair
    """CDist."""
    radial: tuple[float, ...] = ()
    """CoeffDist, of the unit's powers -2, -4, ..."""
    tangential: Pair = (0.0, 0.0)
    """P1, P2, of the unit's power -1."""
    affinity: Pair = (0.0, 0.0)
    """b1, b2."""
    backwards: bool = False
    """Whether the file's distortion leads from the measured place to the ideal one (DistC2M)."""

    @property
    def plain(self) -> bool:
        """Whether an exchanged camera holds it as it is."""
        # design: a relative rounding of the file's own digits.
        near = np.allclose(self.centre, self.principal_point, rtol=0, atol=1e-12 * self.focal)
        return near and self.affinity == (0.0, 0.0) and not self.backwards

    def measured(self, rays: FilmPoints) -> PixelPoints:
        """Places in the file's unit (y down) of rays (x / z, y / z)."""
        ideal = np.array(self.principal_point) + self.focal * rays
        if not self.backwards:
            return self._moved(ideal)
        place = np.array(ideal)
        for _ in range(ROUNDS):
            step = ideal - self._moved(place)
            place = place + step
            if not np.any(np.abs(step) > SETTLED * self.focal):
                break
        return place

    def _moved(self, places: PixelPoints) -> PixelPoints:
        """Where the file's distortion takes places."""
        x, y = (places - np.array(self.centre)).T
        square = x * x + y * y
        factor = sum(value * square**power for power, value in enumerate(self.radial, start=1))
        p1, p2 = self.tangential
        b1, b2 = self.affinity
        step = np.column_stack(
            [
                x * factor + p1 * (square + 2 * x * x) + 2 * p2 * x * y + b1 * x + b2 * y,
                y * factor + p2 * (square + 2 * y * y) + 2 * p1 * x * y,
            ]
        )
        return places + step


@dataclass(frozen=True, slots=True, eq=False)
class HeldLens:
    """A lens as the exchanged block holds it."""

    file_from_image: Affine2
    """2 x 3: places in the file's unit (y down) from distorted image coordinates (y up)."""
    radial: tuple[float, ...]
    """k1, k2, ..."""
    tangential: Pair
    """p1, p2."""
    off: float
    """How far it is off the file's own, at most, in the file's unit; nought where it is exact."""


def fit_held_lens(lens: MicmacLens, size: Pair) -> HeldLens:
    """A lens as the exchanged block holds it: exactly where that can be, else fitted.

    Args:
        lens: The file's.
        size: Width and height of the picture from (0, 0), in the file's unit.
    """
    corner = np.array(lens.principal_point)
    affine = np.column_stack([lens.focal * np.diag(DOWN), corner])
    if lens.plain:
        radial = tuple(c * lens.focal ** (2 * n) for n, c in enumerate(lens.radial, start=1))
        p1, p2 = lens.tangential
        return HeldLens(affine, radial, (p1 * lens.focal, -p2 * lens.focal), 0.0)
    grid = np.stack(np.meshgrid(*(np.linspace(0, side, NODES) for side in size)), axis=-1)
    rays = (grid.reshape(-1, 2) - corner) / lens.focal
    target = (lens.measured(rays) - corner) / lens.focal * DOWN
    linear, shift, radial, tangential = _fitted(rays * DOWN, target)
    camera = ExchangeCamera("", radial, tangential)
    rest = image_from_ideal(rays * DOWN, camera) @ linear.T + shift - target
    off = float(np.hypot(*rest.T).max()) * lens.focal
    whole = np.column_stack([affine[:, :2] @ linear, affine[:, :2] @ shift + corner])
    return HeldLens(whole, radial, tangential, off)


def lens_of(camera: ExchangeCamera, focal: float, principal_point: Pair) -> MicmacLens:
    """A camera's lens in a unit in which its principal distance is `focal`."""
    radial = tuple(k / focal ** (2 * n) for n, k in enumerate(camera.radial, start=1))
    p1, p2 = camera.tangential
    return MicmacLens(focal, principal_point, principal_point, radial, (p1 / focal, -p2 / focal))


def lens_of_frame(frame: FrameCamera, size: Pair) -> tuple[MicmacLens, float]:
    """The lens in pixels (centre of the first pixel) of a camera whose pixels may be sheared.

    MicMac shears the ideal place and an exchanged block the distorted one, so that such a camera
    is fitted where it has both.

    Args:
        frame: The camera.
        size: Columns and rows of the picture.

    Returns:
        The lens, and how far it is off at most, pixels.
    """
    p2, p1 = frame.tangential
    x, y = frame.principal_point_px
    point, focal = (x - HALF_PIXEL, y - HALF_PIXEL), frame.focal_px
    if frame.affinity_px == 0.0 and frame.skew_px == 0.0:
        # The tangential terms of a frame camera are those of y downwards already.
        camera = ExchangeCamera("", frame.radial, (p1, -p2))
        return lens_of(camera, focal, point), 0.0
    grid = np.stack(np.meshgrid(*(np.linspace(0, side, NODES) for side in size)), axis=-1)
    rays = (grid.reshape(-1, 2) - np.array(point)) / focal
    moved = image_from_ideal(rays, ExchangeCamera("", frame.radial, (p1, p2)))
    sheared = moved @ np.array([[focal + frame.affinity_px, 0.0], [frame.skew_px, focal]])
    zero, one = np.zeros(len(rays)), np.ones(len(rays))
    plain = [[rays[:, 0], rays[:, 1]], [one, zero], [zero, one], [rays[:, 0], zero]]
    plain.append([rays[:, 1], zero])
    design = np.stack([np.column_stack(column) for column in plain], axis=2)
    design = np.concatenate([design, _features(rays)], axis=2).reshape(2 * len(rays), -1)
    scale = np.linalg.norm(design, axis=0)
    found = np.linalg.lstsq(design / scale, sheared.reshape(-1), rcond=None)[0] / scale
    off = np.hypot(*(design @ found - sheared.reshape(-1)).reshape(-1, 2).T).max()
    fitted, right, down, b1, b2 = found[:5].tolist()
    own = (point[0] + right, point[1] + down)
    terms = (found[5:] / fitted).tolist()
    camera = ExchangeCamera("", tuple(terms[:FITTED]), (terms[FITTED], -terms[FITTED + 1]))
    plainly = lens_of(camera, fitted, own)
    return replace(plainly, affinity=(b1 / fitted, b2 / fitted)), float(off)


def _fitted(
    ideal: FilmPoints, target: FilmPoints
) -> tuple[Matrix, np.ndarray, tuple[float, ...], Pair]:
    """Affine (linear, shift), radial and tangential terms that lead ideal points to their targets.

    Newton's method: the terms multiply one another, but each alone is linear.
    """
    linear, shift = np.eye(2), np.zeros(2)
    terms = np.zeros(FITTED + 2)
    features = _features(ideal)
    for _ in range(STEPS):
        moved = ideal + features @ terms
        rest = target - (moved @ linear.T + shift)
        zero, one = np.zeros(len(ideal)), np.ones(len(ideal))
        along_x = [moved[:, 0], moved[:, 1], zero, zero, one, zero]
        along_y = [zero, zero, moved[:, 0], moved[:, 1], zero, one]
        places = np.stack([np.column_stack(along_x), np.column_stack(along_y)], axis=1)
        design = np.concatenate([places, np.einsum("ij,njk->nik", linear, features)], axis=2)
        design = design.reshape(2 * len(ideal), -1)
        scale = np.linalg.norm(design, axis=0)
        step = np.linalg.lstsq(design / scale, rest.reshape(-1), rcond=None)[0] / scale
        linear = linear + step[:4].reshape(2, 2)
        shift = shift + step[4:6]
        terms = terms + step[6:]
    radial = tuple(float(value) for value in terms[:FITTED])
    return linear, shift, radial, (float(terms[-2]), float(terms[-1]))


def _features(ideal: FilmPoints) -> np.ndarray:
    """(n, 2, terms): what each term of the lens adds to a point, for the term one."""
    x, y = ideal.T
    square = x * x + y * y
    across = [x * square**n for n in range(1, FITTED + 1)]
    up = [y * square**n for n in range(1, FITTED + 1)]
    across += [square + 2 * x * x, 2 * x * y]
    up += [2 * x * y, square + 2 * y * y]
    return np.stack([np.column_stack(across), np.column_stack(up)], axis=1)
