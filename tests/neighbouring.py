"""Parts of a block, as neighbouring blocks of one flight hold them."""

from dataclasses import replace

import numpy as np

from core.block import TiePoints
from core.geometry.crs import operation_between
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation


def part_of(block, names, points=None):
    """The block of some photos, with what is measured in them of some points."""
    ties = block.ties
    inside = np.array([ties.photo_ids[photo] in names for photo in ties.photo])
    counts = np.bincount(ties.point[inside], minlength=ties.count)
    kept = inside & (counts[ties.point] >= 2)
    own = {name: row for row, name in enumerate(n for n in ties.photo_ids if n in names)}
    photo = np.array([own[ties.photo_ids[row]] for row in ties.photo[kept]])
    point = np.unique(ties.point[kept], return_inverse=True)[1]
    rays = TiePoints(tuple(own), point, photo, ties.pixels[kept], ties.sigma_px[kept])
    measured = {
        key: one
        for key, one in block.measurements.items()
        if key[1] in names and (points is None or key[0] in points)
    }
    shown = {key[0] for key in measured}
    surveyed = {name: one for name, one in block.surveyed.items() if name in shown}
    photos = {name: block.photos[name] for name in own}
    return replace(block, photos=photos, surveyed=surveyed, measurements=measured, ties=rays)


def in_utm(block):
    """A block as its owner would have it in UTM, and the way back."""
    centres = np.array([photo.exterior.centre[:2] for photo in block.photos.values()])
    proj = operation_between(block.crs, "EPSG:32633", centres, "block")

    def moved(points, by=proj.forward):
        return np.column_stack([by(points[:, :2]), points[:, 2]])

    def of(exterior):
        ends = moved(np.array([exterior.centre, exterior.centre + np.array([100.0, 0, 0])]))
        east, north = (ends[1] - ends[0])[:2] / np.linalg.norm((ends[1] - ends[0])[:2])
        turn = np.array([[east, -north, 0.0], [north, east, 0.0], [0.0, 0.0, 1.0]])
        angles = angles_from_rotation(turn @ exterior.object_from_image)
        return ExteriorOrientation(ends[0], *angles)

    photos = {
        name: replace(photo, exterior=of(photo.exterior), approximate=of(photo.approximate))
        for name, photo in block.photos.items()
    }
    surveyed = {
        name: replace(point, position=moved(point.position[None])[0])
        for name, point in block.surveyed.items()
    }
    there = replace(block, crs="EPSG:32633", photos=photos, surveyed=surveyed)
    return there, lambda points: moved(points, proj.backward)
