"""A flight of whose camera nobody states the principal distance any more."""

from dataclasses import replace

from core.block import Block, Photo
from core.geometry.exterior import ExteriorOrientation


def forget_distance(
    block: Block, distance_mm: float, sigma_mm: float, lifted: bool = True
) -> Block:
    """The block as it is when nobody states the principal distance, and one is proposed.

    Where `lifted`, photos stand as high as their scale and the proposed distance put them.
    """
    (name,) = block.cameras
    camera = block.cameras[name].at_distance(distance_mm, sigma_mm)
    camera = replace(camera, distances_mm=((distance_mm, sigma_mm),))
    ratio = distance_mm / block.cameras[name].principal_distance_mm if lifted else 1.0

    def raised(photo: Photo, exterior: ExteriorOrientation) -> ExteriorOrientation:
        centre = exterior.centre.copy()
        centre[2] = photo.ground_height_m + ratio * (centre[2] - photo.ground_height_m)
        return replace(exterior, centre=centre)

    photos = {
        key: replace(
            photo,
            exterior=raised(photo, photo.exterior),
            approximate=raised(photo, photo.approximate),
        )
        for key, photo in block.photos.items()
    }
    return replace(block, cameras={name: camera}, photos=photos)
