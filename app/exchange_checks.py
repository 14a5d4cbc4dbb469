"""What another program's file says of a block, held against what is known of the block itself.

A file can be sound and still not be of this block, or not be meant as it is read: places beside the
scan, one point at two places of a scan, photos below the ground. Nothing of such a file comes in.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.block import Block, Photo
from core.errors import ProjectError
from core.exchange import UPRIGHT_SUFFIX, upright_frame
from core.formats.exchange import ExchangeBlock, ExchangeMeasurement
from core.formats.point_axes import SAME_M
from core.formats.records import scan_stem
from core.geometry.exterior import turn_between
from core.raster.scan_pixels import open_dataset
from core.said import say

SAME_PX = 1e-3  # design: digits that programs leave
"""A point at two places of one photo that are no further apart is measured once."""
RIM_PX = 1.0  # design: programs count from the corner or from the middle of the first pixel
"""So far beside a scan a place may lie."""
FAR_M = 50_000.0  # design: no block is so wide; a wrong CRS is off by more
"""Photos this far from the block do not belong to it, metres."""
# design: georeferences of archives are off by some degrees, and by quarters of a turn if at all.
TURNED = np.radians(30)
"""Photos turned by more against what is known of them are told."""
SIGMAS = 3.0  # design: one place in a hundred lies further from what is stated of it
"""So many standard deviations a photo may be from where an archive puts it."""


def on_scans(
    foreign: ExchangeBlock, own: Mapping[str, str], block: Block | None, path: Path
) -> ExchangeBlock:
    """Pixels of photos that an export laid upright, as the scans have them.

    Args:
        foreign: What the file says.
        own: The block's photos by the foreign name.
        block: The block, whose interior orientations laid the scans upright.
        path: The file.

    Raises:
        ProjectError: There is no interior orientation of such a photo yet.
    """
    laid = {
        theirs: ours
        for theirs, ours in own.items()
        if scan_stem(theirs).removesuffix(UPRIGHT_SUFFIX) != scan_stem(theirs)
        and not scan_stem(ours).endswith(UPRIGHT_SUFFIX)
    }
    if not laid or not foreign.measurements:
        return foreign
    if block is None or not set(laid.values()) <= set(block.photos):
        raise ProjectError(
            path,
            "measures scans that were laid upright, and nothing tells yet how these scans lie.",
            "Run the block first: gruber run BLOCK --until scans.",
        )

    def moved(one: ExchangeMeasurement) -> ExchangeMeasurement:
        photo = block.photos[laid[one.photo_id]]
        frame = upright_frame(photo, block.camera_of(photo.photo_id))
        if frame is None:
            return one
        film = frame.film_from_pixel(np.array([[one.column, one.row]]))
        column, row = photo.interior.pixel_from_film(film)[0].tolist()
        return replace(one, column=column, row=row)

    measured = (moved(one) if one.photo_id in laid else one for one in foreign.measurements)
    return replace(foreign, measurements=tuple(measured))


def without_known(
    foreign: ExchangeBlock, block: Block | None, path: Path
) -> tuple[ExchangeBlock, tuple[str, ...]]:
    """The points that the block does not have at that very place, and a word on those it has.

    Most formats know neither roles nor standard deviations: a check point that comes back with its
    measurements must not become control.

    Raises:
        ProjectError: A point that the block found itself is given another place.
    """
    found = {} if block is None else block.surveyed
    known: list[str] = []
    for name, point in foreign.points.items():
        ours = found.get(name)
        if ours is None:
            continue
        if np.abs(np.array(point.position) - ours.position).max() <= SAME_M:
            known.append(name)
        elif ours.source != "surveyed":
            raise ProjectError(
                path,
                say("the block has a point of another kind that is called {name}.", name=name),
                say("Give the point another name."),
            )
    if not known:
        return foreign, ()
    points = {name: point for name, point in foreign.points.items() if name not in known}
    told = say(
        "{count:# point stays|# points stay} as the block has them, such as {name}.",
        count=len(known),
        name=known[0],
    )
    return replace(foreign, points=points), (told,)


def check_measurements(
    foreign: ExchangeBlock, own: Mapping[str, str], scans: Mapping[str, Path], path: Path
) -> None:
    """Refuse places beside the scan, and a point at two places of one scan.

    Args:
        foreign: What the file says.
        own: The block's photos by the foreign name.
        scans: Files of the block's photos.
        path: The file.

    Raises:
        ProjectError: A measurement cannot be.
        ScanError: A scan cannot be opened.
    """
    known: dict[tuple[str, str], tuple[float, float]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    for one in foreign.measurements:
        ours = own.get(one.photo_id)
        if ours is None or foreign.on_film:
            continue
        if ours not in sizes:
            with open_dataset(scans[ours]) as dataset:
                sizes[ours] = (dataset.width, dataset.height)
        place, (columns, rows) = (one.column, one.row), sizes[ours]
        if not (-RIM_PX <= place[0] <= columns + RIM_PX and -RIM_PX <= place[1] <= rows + RIM_PX):
            raise ProjectError(
                path,
                "measures {point} in {photo} at column {column:.1f}, row {row:.1f}; the scan has "
                "{columns} columns and {rows} rows.",
                "Export it again with the pixels of these very scans.",
                point=one.point_id,
                photo=ours,
                column=place[0],
                row=place[1],
                columns=columns,
                rows=rows,
            )
        before = known.setdefault((one.point_id, ours), place)
        if max(abs(before[0] - place[0]), abs(before[1] - place[1])) > SAME_PX:
            raise ProjectError(
                path,
                "measures {point} in {photo} twice, at two places.",
                "Keep one of them.",
                point=one.point_id,
                photo=ours,
            )


def check_exteriors(
    foreign: ExchangeBlock, own: Mapping[str, str], block: Block | None, path: Path
) -> tuple[str, ...]:
    """Refuse photos far from the block or below its ground; say where they are turned against it.

    Args:
        foreign: What the file says, in the block's CRS.
        own: The block's photos by the foreign name.
        block: The block as far as it was run; None where nothing places its photos.
        path: The file.

    Raises:
        ProjectError: The photos cannot lie there.
    """
    given = {
        ours: foreign.photos[theirs].exterior
        for theirs, ours in own.items()
        if block is not None and ours in block.photos
    }
    placed = {name: exterior for name, exterior in given.items() if exterior is not None}
    if block is None or not placed:
        return ()
    centres = np.array([exterior.centre for exterior in placed.values()])
    there = np.array([block.photos[name].exterior.centre for name in placed])
    unsure_m, unsure_rad = np.array([_unsure(block.photos[name]) for name in placed]).T
    away = np.hypot(*(centres - there)[:, :2].T)
    far = float(np.median(away))
    if np.median(away - unsure_m) > FAR_M:
        raise ProjectError(
            path,
            "The photos lie {far:,.0f} km from the block.",
            "Give easting and northing in the CRS of the block, {crs}.",
            far=far / 1000,
            crs=block.crs,
        )
    ground = np.array([block.photos[name].ground_height_m for name in placed])
    low = [name for name, above in zip(placed, centres[:, 2] - ground, strict=True) if above <= 0]
    if low:
        raise ProjectError(
            path,
            "{name} lies below the ground of the block.",
            "Give heights in metres above the same level as the block's DEM.",
            name=low[0],
        )
    turns = [
        turn_between(exterior.object_from_image, block.photos[name].exterior.object_from_image)
        for name, exterior in placed.items()
    ]
    off = np.linalg.norm(turns, axis=1)
    if np.median(off - unsure_rad) <= TURNED:
        return ()
    return (
        say(
            "The photos are turned by {angle:.0f} degrees against what the block knew of them: "
            "angles of another unit, order or sign?",
            angle=float(np.degrees(np.median(off))),
        ),
    )


def _unsure(photo: Photo) -> tuple[float, float]:
    """How far a photo may be from where the block has it: metres, radians."""
    if photo.oriented:
        return 0.0, 0.0
    sigmas = photo.prior.sigma_centre_m, photo.prior.sigma_angles
    metres, radians = (SIGMAS * float(np.max(sigma)) for sigma in sigmas)
    return metres, radians
