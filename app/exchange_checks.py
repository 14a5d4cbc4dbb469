"""What another program's file says of a block, held against what is known of the block itself.

A file can be sound and still not be of this block, or not be meant as it is read: places beside the
scan, one point at two places of a scan, photos below the ground. Nothing of such a file comes in.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.block import Block, Photo, SurveyedPoint
from core.errors import ProjectError
from core.exchange import is_laid_upright, upright_frame
from core.formats.eo_format import FAR_M
from core.formats.exchange import ExchangeBlock, ExchangeMeasurement, ExchangePoint
from core.formats.point_axes import SAME_M
from core.formats.rotations import triple_of
from core.geometry.exterior import turn_between
from core.raster.scan_pixels import open_dataset
from core.said import say

SAME_PX = 1e-3  # design: digits that programs leave
"""A point at two places of one photo that are no further apart is measured once."""
RIM_PX = 1.0  # design: programs count from the corner or from the middle of the first pixel
"""So far beside a scan a place may lie."""
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
    measured = {one.photo_id for one in foreign.measurements}
    laid = {t: o for t, o in own.items() if t in measured and is_laid_upright(t, o)}
    if not laid:
        return foreign
    unknown = [ours for ours in laid.values() if block is None or ours not in block.photos]
    if block is None or unknown:
        raise ProjectError(
            path,
            "measures {name} laid upright, and nothing tells yet how that scan lies.",
            "Run the block first: gruber run BLOCK --until georeference.",
            name=unknown[0],
        )

    def moved(one: ExchangeMeasurement) -> ExchangeMeasurement:
        photo = block.photos[laid[one.photo_id]]
        frame = upright_frame(photo, block.camera_of(photo.photo_id))
        if frame is None:
            return one
        film = frame.film_from_pixel(np.array([[one.column, one.row]]))
        column, row = photo.interior.pixel_from_film(film)[0].tolist()
        return replace(one, column=column, row=row)

    places = (moved(one) if one.photo_id in laid else one for one in foreign.measurements)
    return replace(foreign, measurements=tuple(places))


def without_known(
    foreign: ExchangeBlock, known: Mapping[str, SurveyedPoint], path: Path
) -> tuple[ExchangeBlock, tuple[str, ...]]:
    """The points that the block does not have at that very place, and words on those it has.

    Most formats know no roles, and many no standard deviations: a check point that comes back with
    its measurements stays one, wherever it is put, and keeps what the file does not say.

    Args:
        foreign: What the file says, in the block's CRS.
        known: All points of the block, listed and brought ones among them.
        path: The file.

    Raises:
        ProjectError: A point that the block found itself is given another place.
    """
    points: dict[str, ExchangePoint] = {}
    staying: list[str] = []
    moved: list[str] = []
    for name, point in foreign.points.items():
        ours = known.get(name)
        if ours is None:
            points[name] = point
        elif np.abs(np.array(point.position) - ours.position).max() <= SAME_M:
            staying.append(name)
        elif ours.source != "surveyed":
            raise ProjectError(
                path,
                say("the block has a point of another kind that is called {name}.", name=name),
                say("Give the point another name."),
            )
        else:
            moved.append(name)
            role = "check" if ours.role == "check" else "control"
            points[name] = replace(
                point, role=role, sigma_m=point.sigma_m or triple_of(ours.sigma_m)
            )
    told: list[str] = []
    if staying:
        told.append(
            say(
                "{count:# point stays|# points stay} as the block has them, such as {name}.",
                count=len(staying),
                name=staying[0],
            )
        )
    if moved:
        told.append(
            say(
                "{count:# point of the block moves|# points of the block move} to the places of "
                "the file and keep their roles: {names}.",
                count=len(moved),
                names=moved[:5],
            )
        )
    return replace(foreign, points=points), tuple(told)


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
    foreign: ExchangeBlock, own: Mapping[str, str], block: Block | None, held: bool, path: Path
) -> tuple[str, ...]:
    """Say where photos lie or are turned otherwise than the block has them; refuse what is absurd.

    Args:
        foreign: What the file says, in the block's CRS.
        own: The block's photos by the foreign name.
        block: The block as far as it was run; None where nothing places its photos.
        held: Whether a reference says where the block lies. What an earlier list alone said may
            be what this one corrects.
        path: The file.

    Raises:
        ProjectError: The photos cannot lie there.
    """
    if block is None:
        return ()
    given = ((ours, foreign.photos[t].centre) for t, ours in own.items() if ours in block.photos)
    placed = {name: centre for name, centre in given if centre is not None}
    if not placed:
        return ()
    photos = [block.photos[name] for name in placed]
    centres = np.array(list(placed.values()))
    away = np.hypot(*(centres - [photo.exterior.centre for photo in photos])[:, :2].T)
    unsure_m = np.array([_unsure(photo)[0] for photo in photos])
    told: list[str] = []
    if np.median(away - unsure_m) > FAR_M:
        far = say(
            "The photos lie {far:,.0f} km from where the block has them.",
            far=float(np.median(away)) / 1000,
        )
        if held:
            remedy = "Give easting and northing in the CRS of the block, {crs}."
            raise ProjectError(path, far, say(remedy, crs=block.crs))
        told.append(far)
    ground = np.array([photo.ground_height_m for photo in photos])
    low = [name for name, above in zip(placed, centres[:, 2] - ground, strict=True) if above <= 0]
    if low and held and not told:
        raise ProjectError(
            path,
            "{name} lies below the ground of the block.",
            "Give heights in metres above the same level as the block's DEM.",
            name=low[0],
        )
    return (*told, *_told_turns(foreign, own, block))


def _told_turns(foreign: ExchangeBlock, own: Mapping[str, str], block: Block) -> tuple[str, ...]:
    """A word where photos are turned otherwise than the block has them."""
    turned = [
        (exterior.object_from_image, block.photos[ours])
        for theirs, ours in own.items()
        if ours in block.photos and (exterior := foreign.photos[theirs].exterior) is not None
    ]
    if not turned:
        return ()
    off = np.array(
        [
            np.linalg.norm(turn_between(rotation, photo.exterior.object_from_image))
            for rotation, photo in turned
        ]
    )
    if np.median(off - [_unsure(photo)[1] for _, photo in turned]) <= TURNED:
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
