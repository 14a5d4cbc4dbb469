"""Exterior orientation lists as exchange formats: read and written.

`eo` reads the convention that a list states and writes omega, phi, kappa in degrees; `eo-opk-gon`
and the others read and write one fixed convention.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from core.errors import ProjectError
from core.formats.eo_list import ASKED, NAMED, EoList, EoRecord, read_eo_records
from core.formats.exchange import Conventions, ExchangeBlock, ExchangeFormat, ExchangePhoto, Triple
from core.formats.film_rays import median_misfit, not_oriented
from core.formats.records import write_rows
from core.formats.rotations import CONVENTIONS, RADIANS, AngleConvention, angles_of, rotation_of
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, turn_between
from core.said import say

PLAIN = AngleConvention("omega-phi-kappa", "deg")
"""What `eo` writes."""
# design: a survey photo looks within some degrees of straight down, an oblique one beyond 30.
STEEP = np.radians(30)
"""Photos that look further from straight down are told: oblique, or columns mixed up."""
# design: a wrong convention misses by a hundred times as much as a right one.
CLEARLY = 3.0
"""How many times worse the second way of counting must fit for the first to be taken."""

# design: no block is so wide; swapped axes move Czechia by hundreds of kilometres.
FAR_M = 50_000.0
"""Photos this far from all that is known of the block do not belong to it, metres."""


def read_eo_block(
    path: Path,
    said: AngleConvention | None = None,
    known: ExchangeBlock | None = None,
    heads: Sequence[str] = (),
) -> ExchangeBlock:
    """The orientations of a list.

    Args:
        path: The list.
        said: How its angles count, where somebody said it.
        known: What is known of the same photos: measurements of points that have coordinates, or
            approximate orientations. Where neither list nor caller says how angles count, the way
            that fits these is taken, if it is the only one that does.
        heads: What its columns hold, where somebody said it; see `read_eo_records`.

    Raises:
        ProjectError: The list cannot be used, or nothing tells how it counts or what it holds.
    """
    told = ""
    try:
        listed = read_eo_records(path, said, heads)
    except ProjectError as error:
        if error.remedy != ASKED or known is None:
            raise
        best, told = fitting_convention(path, known, heads)
        listed = read_eo_records(path, best, heads)
    if known is not None:
        _check_axes(path, listed, known)
        if said is None and not told:
            _check_angles(path, listed, known)
    photos = {name: _photo(record) for name, record in listed.records.items()}
    if listed.perhaps_angles:
        raise ProjectError(
            path,
            "Columns {names} hold numbers where angles usually stand, but their names do "
            "not say so.",
            NAMED,
            names=", ".join(listed.perhaps_angles),
        )
    notes = [told] if told else []
    if listed.unread:
        notes.append(say("Columns that are not read: {unread}", unread=list(listed.unread)))
    steep = list(_steep(listed.records, STEEP))
    if steep:
        notes.append(
            say(
                "{count:# photo looks|# photos look} more than 30 degrees from straight down "
                "({names}): oblique photos, or columns mixed up?",
                count=len(steep),
                names=", ".join(steep[:3]),
            )
        )
    return ExchangeBlock(crs=listed.crs, photos=photos, notes=tuple(notes))


def _steep(records: Mapping[str, EoRecord], limit: float) -> Iterator[str]:
    """Scans whose photo looks further from straight down than a limit, radians."""
    for name, record in records.items():
        if record.angles is not None:
            omega, phi, _ = record.angles
            if np.cos(omega) * np.cos(phi) < np.cos(limit):
                yield name


def _photo(record: EoRecord) -> ExchangePhoto:
    if record.angles is None:
        return ExchangePhoto(
            record.scan,
            record.file,
            position=record.centre,
            sigma_centre_m=record.sigma_centre_m,
        )
    exterior = ExteriorOrientation(np.array(record.centre), *record.angles)
    return ExchangePhoto(
        record.scan,
        record.file,
        exterior=exterior,
        sigma_centre_m=record.sigma_centre_m,
        sigma_angles=record.sigma_angles,
    )


def _check_angles(path: Path, listed: EoList, known: ExchangeBlock) -> None:
    """Refuse a list whose angles fit what is known far better in another way than it says."""
    photos = {name: _photo(record) for name, record in listed.records.items() if record.angles}
    stated, unit = _misfit(ExchangeBlock(photos=photos), known)
    others: list[tuple[float, str]] = []
    for convention in CONVENTIONS:
        counted = {
            name: _photo(replace(record, angles=_angles(record.written, convention)))
            for name, record in listed.records.items()
            if record.written is not None
        }
        others.append((_misfit(ExchangeBlock(photos=counted), known)[0], convention.name))
    best, name = min(others, default=(np.inf, ""))
    if np.isfinite(best) and CLEARLY * best < stated:
        raise ProjectError(
            path,
            "Angles read as the list says miss what is known of the photos by {stated:.3g} {unit}; "
            "as {best} by {least:.3g}.",
            ASKED,
            stated=stated,
            unit=unit,
            best=f"eo-{name}",
            least=best,
        )


def _angles(written: Triple | None, convention: AngleConvention) -> Triple:
    """omega, phi, kappa (radians) of three angles as a list gives them."""
    assert written is not None, "only rows with angles are counted"
    first, second, third = (value * RADIANS[convention.unit] for value in written)
    return angles_from_rotation(rotation_of(convention.order, (first, second, third)))


def _check_axes(path: Path, listed: EoList, known: ExchangeBlock) -> None:
    """Refuse a list that comes to lie where the block is only when its axes are swapped."""
    places = [point.position for point in known.points.values()]
    places += [
        tuple(photo.exterior.centre.tolist())
        for photo in known.photos.values()
        if photo.exterior is not None
    ]
    if not places or not listed.records:
        return
    there = np.median(np.array(places)[:, :2], axis=0)
    here = np.median([record.centre[:2] for record in listed.records.values()], axis=0)
    given, *others = (
        float(np.hypot(*(there - place))) for place in (here, here[::-1], -here[::-1], -here)
    )
    if given > FAR_M and min(others) * CLEARLY < given:
        raise ProjectError(
            path,
            "The photos lie {far:,.0f} km from the block; with axes swapped or signs turned "
            "{near:,.0f} km.",
            "Give X as easting and Y as northing in the CRS of the block (for S-JTSK that is "
            "EPSG:5514, both negative).",
            far=given / 1000,
            near=min(others) / 1000,
        )


def fitting_convention(
    path: Path, known: ExchangeBlock, heads: Sequence[str] = ()
) -> tuple[AngleConvention, str]:
    """The one way of counting that agrees with what is known, and a sentence that says how well.

    Raises:
        ProjectError: Nothing is known of the photos of the list, or several ways fit alike.
    """
    fits: list[tuple[float, AngleConvention, str]] = []
    refused: ProjectError | None = None
    for convention in CONVENTIONS:
        try:
            misfit, unit = _misfit(read_eo_block(path, convention, heads=heads), known)
        except ProjectError as error:
            refused = error
            continue
        if np.isfinite(misfit):
            fits.append((misfit, convention, unit))
    if not fits and refused is not None:
        raise refused
    fits.sort(key=lambda fit: fit[0])
    if not fits:
        raise ProjectError(
            path, "Nothing that is known of these photos tells how the list counts angles.", ASKED
        )
    best, second = fits[0], fits[1] if len(fits) > 1 else None
    if second is not None and second[0] < CLEARLY * best[0]:
        raise ProjectError(
            path,
            "Angles fit as {best} ({first:.3g} {unit}) and as {other} ({second:.3g} {unit}).",
            ASKED,
            best=f"eo-{best[1].name}",
            first=best[0],
            other=f"eo-{second[1].name}",
            second=second[0],
            unit=best[2],
        )
    told = say(
        "Angles are read as {order} in {angle_unit}: they fit within {misfit:.3g} {unit}; "
        "the next best way, {other}, is off by {second:.3g}.",
        order=best[1].order,
        angle_unit=best[1].unit,
        misfit=best[0],
        unit=best[2],
        other="-" if second is None else f"eo-{second[1].name}",
        second=np.inf if second is None else second[0],
    )
    return best[1], told


def _misfit(listed: ExchangeBlock, known: ExchangeBlock) -> tuple[float, str]:
    """How far a list is from what is known: pixels where points are measured, else degrees."""
    photos = {
        name: replace(photo, exterior=listed.photos[name].exterior)
        for name, photo in known.photos.items()
        if name in listed.photos
    }
    off = median_misfit(replace(known, photos=photos))
    if np.isfinite(off) or known.measurements:
        return off, "px"
    turns: list[float] = []
    for name, photo in listed.photos.items():
        prior = known.photos[name].exterior if name in known.photos else None
        if prior is not None and photo.exterior is not None:
            turn = turn_between(photo.exterior.object_from_image, prior.object_from_image)
            turns.append(float(np.linalg.norm(turn)))
    return (float(np.degrees(np.median(turns))), "deg") if turns else (np.inf, "deg")


def write_eo_block(
    path: Path, block: ExchangeBlock, convention: AngleConvention = PLAIN
) -> tuple[str, ...]:
    """Write the photos of a block that lie anywhere, one a row, every digit.

    Of a photo whose position alone is known the angles stay empty.

    Returns:
        What was left out.
    """
    unit, names = convention.unit, convention.order.split("-")
    plain = convention.order == PLAIN.order
    sigmas = [f"sigma_{name}" for name in "XYZ"]
    if plain:
        sigmas += [f"sigma_{name}_{unit}" for name in names]
    above = [f"# CRS: {block.crs}"] if block.crs else []
    above.append(f"# angles: {convention.order}, {unit}")
    rows = [["scan", "X", "Y", "Z", *(f"{n}_{unit}" for n in names), *sigmas]]
    for photo in block.photos.values():
        if photo.centre is None:
            continue
        cells = [photo.file or photo.photo_id, *_values(photo.centre, 1.0)]
        turned = None
        if photo.exterior is not None:
            turned = angles_of(convention.order, photo.exterior.object_from_image)
        cells += _values(turned, RADIANS[unit])
        cells += _values(photo.sigma_centre_m, 1.0)
        if plain:
            cells += _values(photo.sigma_angles, RADIANS[unit])
        rows.append(cells)
    write_rows(path, rows, above)
    return left_out(block, turned=plain)


def _values(values: Triple | None, unit: float) -> list[str]:
    return ["", "", ""] if values is None else [repr(float(value / unit)) for value in values]


def left_out(block: ExchangeBlock, *, turned: bool = True) -> tuple[str, ...]:
    """What of a block a list of orientations does not hold, a sentence each."""
    notes = [*not_oriented(photo for photo in block.photos.values() if photo.position is None)]
    if not turned and any(photo.sigma_angles for photo in block.photos.values()):
        notes.append(
            say("Standard deviations are those of omega, phi, kappa: angles carry none here.")
        )
    if block.points or block.measurements or len(block.ties.point) or block.cameras:
        notes.append(say("The list holds orientations alone: no cameras, points or measurements."))
    return tuple(notes)


def _writer(convention: AngleConvention) -> Callable[[Path, ExchangeBlock], tuple[str, ...]]:
    return lambda path, block: write_eo_block(path, block, convention)


ROTATIONS = {
    "omega-phi-kappa": "R = R_x(omega) R_y(phi) R_z(kappa) turns image space into object space",
    "phi-omega-kappa": "R = R_y(phi) R_x(omega) R_z(kappa) turns image space into object space",
    "yaw-pitch-roll": "yaw clockwise from grid north, pitch lifts the photo's upper edge, roll "
    "lowers its right edge; all nought looks straight down with the upper edge north",
}
"""Each order in words."""
UNIT_NAMES = {"deg": "degrees", "gon": "gon", "rad": "radians"}
"""Each unit in words."""


def _conventions(convention: AngleConvention, reads: str) -> Conventions:
    sigmas = "centre, metres"
    if convention.order == PLAIN.order:
        sigmas += f"; omega, phi, kappa, {UNIT_NAMES[convention.unit]}"
    return Conventions(
        object_space="easting, northing, height, metres; the CRS in a comment",
        rotation=f"{ROTATIONS[convention.order]}; {UNIT_NAMES[convention.unit]}{reads}",
        sigmas=sigmas,
        lost="cameras, interior orientations, points, measurements, ties; photos not oriented",
        tested="ERDAS (Addis Ababa, radians) and IGN (opk-alex, degrees) lists of photos whose "
        "measurements are known"
        if convention.order == PLAIN.order
        else "untested on real files",
    )


def _format(convention: AngleConvention) -> ExchangeFormat:
    return ExchangeFormat(
        name=f"eo-{convention.name}",
        title=say(
            "Exterior orientations: {order}, {unit}",
            order=convention.order,
            unit=UNIT_NAMES[convention.unit],
        ),
        conventions=_conventions(convention, ""),
        holds="nothing",
        write=_writer(convention),
        read=partial(read_eo_block, said=convention),
        default_name=f"exterior-{convention.name}.csv",
        folder=False,
    )


EO_FORMATS: tuple[ExchangeFormat, ...] = (
    ExchangeFormat(
        name="eo",
        title="Exterior orientations: a list that says how it counts",
        conventions=_conventions(
            PLAIN, "; lists that say so are read in any order and unit, others are asked about"
        ),
        holds="nothing",
        write=_writer(PLAIN),
        read=read_eo_block,
        default_name="exterior.csv",
        folder=False,
    ),
    *(_format(convention) for convention in CONVENTIONS),
)
"""`eo`, and one format for each order and unit."""
EO_READERS: Mapping[str, Callable[..., ExchangeBlock]] = {
    form.name: form.read for form in EO_FORMATS if form.read is not None
}
"""Reads each of them; takes what is known of the photos as `known`."""
