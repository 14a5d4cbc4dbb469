"""PAT-B: exterior orientations as matrices, image points in micrometres, control.

By its description (PCI on PAT-B; Vr Mapping): numbers for photos and points, three records a photo
for its orientation, groups of points that end with -99. `names.csv`, which is ours, keeps the names
that the numbers stand for. Image points are free of lens distortion, from the principal point.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangePhoto,
    ExchangePoint,
)
from core.formats.film_rays import (
    END,
    MICROMETRES,
    FilmRay,
    block_of_rays,
    film_rays,
    median_misfit,
    not_oriented,
    numbered,
    photo_groups,
    principal_distance_mm,
    refuse_twice,
    refuse_unknown,
    untested,
)
from core.formats.records import Record, only_file, read_records, read_rows, write_lines, write_rows
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.said import say

ORIENTATIONS, IMAGE, CONTROL = "patb_eo.txt", "patb_img.im", "patb_cntl.con"
"""Names of the files, as PCI gives them."""
CHECKS, NAMES = "patb_check.con", "names.csv"
"""Check points apart, so that none steers; what the numbers stand for."""
KINDS = ("kind", "number", "name", "file")
"""Columns of the file of names."""
ROUND = 1e-6  # design: twelve digits of a matrix leave far less.
"""How far a matrix may be from a rotation."""
SECOND, THIRD = 5, 4  # source: PCI on PAT-B; nine numbers of the matrix on two records.


def write_patb(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write orientations, image points and control into a folder.

    Returns:
        What was left out.
    """
    path.mkdir(parents=True, exist_ok=True)
    rays, notes = film_rays(block)
    names = [*block.points, *(ray.point_id for ray in rays)]
    photo_numbers, point_numbers = numbered(block.photos), numbered(names)
    lines: list[str] = []
    for name, photo in block.photos.items():
        if photo.exterior is not None:
            lines += _orientation(photo_numbers[name], photo.exterior)
    write_lines(path / ORIENTATIONS, lines)
    write_lines(path / IMAGE, _image_lines(block, rays, photo_numbers, point_numbers))
    for file, role in ((CONTROL, "control"), (CHECKS, "check")):
        rows = [
            f"{point_numbers[name]} " + " ".join(map(repr, point.position))
            for name, point in block.points.items()
            if point.role == role
        ]
        if rows or role == "control":
            write_lines(path / file, [*rows, END])
    listed = [("photo", n, name, block.photos[name].file) for name, n in photo_numbers.items()]
    listed += [("point", n, name, "") for name, n in point_numbers.items()]
    write_rows(path / NAMES, [KINDS, *listed])
    return (*notes, *_lost(block), untested())


def _lost(block: ExchangeBlock) -> Iterator[str]:
    """What the format has no place for."""
    if any(one.sigma_m for one in block.points.values()) or any(
        one.sigma_px for one in block.measurements
    ):
        yield say("The format holds no standard deviations.")
    yield from not_oriented(block.photos.values())


def _orientation(number: str, exterior: ExteriorOrientation) -> list[str]:
    """Three records: I16, 16x, 3F16.5; 5F16.12; 4F16.12."""
    east, north, height = exterior.centre.tolist()
    entries = exterior.object_from_image.ravel().tolist()
    return [
        f"{number:>16}{'':16}{east:16.5f}{north:16.5f}{height:16.5f}",
        "".join(f"{value:16.12f}" for value in entries[:SECOND]),
        "".join(f"{value:16.12f}" for value in entries[SECOND:]),
    ]


def _image_lines(
    block: ExchangeBlock,
    rays: Sequence[FilmRay],
    photo_numbers: Mapping[str, str],
    point_numbers: Mapping[str, str],
) -> Iterator[str]:
    """Photo and principal distance, its points, -99; and -99 at the end."""
    for name, number in photo_numbers.items():
        seen = [ray for ray in rays if ray.photo_id == name]
        if seen:
            yield f"{number} {principal_distance_mm(block, name) * MICROMETRES!r}"
            for ray in seen:
                x, y = ray.x_mm * MICROMETRES, ray.y_mm * MICROMETRES
                yield f"{point_numbers[ray.point_id]} {x!r} {y!r}"
            yield END
    yield END


def read_patb(path: Path) -> ExchangeBlock:
    """A folder of the three files, or a file of orientations alone.

    The matrices are taken as turning image space into object space; where measured control says
    that they turn the other way, they are turned round, and the block notes it.

    Raises:
        ProjectError: No orientations are there, or a file is damaged.
    """
    if not path.is_dir():
        return block_of_rays([(one, 1.0) for one in _photos(path, {}).values()], {}, [])
    listed = only_file(path, ORIENTATIONS, "*.ori")
    if listed is None:
        raise ProjectError(
            path,
            "holds no {file}.",
            "Give the folder with patb_eo.txt, patb_img.im and patb_cntl.con.",
            file=ORIENTATIONS,
        )
    names = _names(path / NAMES)
    photos = _photos(listed, names)
    points: dict[str, ExchangePoint] = {}
    for file, role in ((CONTROL, "control"), (CHECKS, "check")):
        if (path / file).exists():
            points |= _points(path / file, names, role == "check", points)
    rays: list[FilmRay] = []
    distances: dict[str, float] = {}
    if (path / IMAGE).exists():
        rays, distances = _rays(path / IMAGE, names)
        refuse_twice(path / IMAGE, rays)
        refuse_unknown(path / IMAGE, rays, photos)
    every = [(photo, distances.get(name, 1.0)) for name, photo in photos.items()]
    given = block_of_rays(every, points, rays)
    turned = block_of_rays([(_turned(one), distance) for one, distance in every], points, rays)
    if median_misfit(turned) < median_misfit(given):
        told = say("The matrices turn object space into image space: measured control says so.")
        return replace(turned, notes=(*turned.notes, told))
    return given


def _turned(photo: ExchangePhoto) -> ExchangePhoto:
    """The same photo with its matrix the other way round."""
    assert photo.exterior is not None
    angles = angles_from_rotation(photo.exterior.object_from_image.T)
    exterior = ExteriorOrientation(photo.exterior.centre, *angles)
    return ExchangePhoto(photo.photo_id, photo.file, photo.camera, exterior=exterior)


def _names(path: Path) -> dict[tuple[str, str], tuple[str, str]]:
    """Name and file by kind and number; empty where nobody kept them."""
    if not path.exists():
        return {}
    rows = ([row.cell(key) for key in KINDS] for row in read_rows(path, KINDS))
    return {(kind, number): (name, file) for kind, number, name, file in rows}


def _photos(
    path: Path, names: Mapping[tuple[str, str], tuple[str, str]]
) -> dict[str, ExchangePhoto]:
    records = read_records(path, comment="")
    photos: dict[str, ExchangePhoto] = {}
    if not records or len(records) % 3:
        raise ProjectError(
            path,
            "holds {count:# line|# lines}, not three for every photo.",
            "Each photo has a line with number and position, and two with its matrix.",
            count=len(records),
        )
    for first, second, third in zip(records[::3], records[1::3], records[2::3], strict=True):
        number = first.text(0)
        name, file = names.get(("photo", number), (number, ""))
        first.refuse_again(name, photos)
        entries = [second.value(n) for n in range(SECOND)] + [third.value(n) for n in range(THIRD)]
        matrix = np.array(entries).reshape(3, 3)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > ROUND or np.linalg.det(matrix) < 0:
            raise second.refused(
                "Line {number}: the matrix of photo {photo} is no rotation.",
                "Nine numbers, row by row, of a right-handed rotation.",
                photo=name,
            )
        left, _, right = np.linalg.svd(matrix)
        exterior = ExteriorOrientation(
            np.array(first.triple(1)), *angles_from_rotation(left @ right)
        )
        photos[name] = ExchangePhoto(name, file or f"{name}.tif", exterior=exterior)
    return photos


def _points(
    path: Path,
    names: Mapping[tuple[str, str], tuple[str, str]],
    check: bool,
    known: Mapping[str, ExchangePoint],
) -> dict[str, ExchangePoint]:
    points: dict[str, ExchangePoint] = {}
    for record in _groups(path):
        name = names.get(("point", record.text(0)), (record.text(0), ""))[0]
        record.refuse_again(name, {**points, **known})
        role = "check" if check else "control"
        points[name] = ExchangePoint(name, record.triple(1), role=role)
    return points


def _groups(path: Path) -> list[Record]:
    """Lines of a file that ends with -99."""
    records = read_records(path, comment="")
    if not records or records[-1].text(0) != END:
        raise ProjectError(path, "does not end with -99.", "The file was cut off: give all of it.")
    return [record for record in records if record.text(0) != END]


def _rays(
    path: Path, names: Mapping[tuple[str, str], tuple[str, str]]
) -> tuple[list[FilmRay], dict[str, float]]:
    """Measurements, and principal distances by photo, millimetres."""
    rays: list[FilmRay] = []
    distances: dict[str, float] = {}
    _groups(path)
    for head, rows in photo_groups(path):
        photo = names.get(("photo", head.text(0)), (head.text(0), ""))[0]
        distances[photo] = head.value(1) / MICROMETRES
        for row in rows:
            point = names.get(("point", row.text(0)), (row.text(0), ""))[0]
            rays.append(
                FilmRay(point, photo, row.value(1) / MICROMETRES, row.value(2) / MICROMETRES)
            )
    return rays, distances


PATB_FORMAT = ExchangeFormat(
    name="patb",
    title="PAT-B: orientations, image points, control",
    conventions=Conventions(
        pixels="none: micrometres of film from the principal point, x right, y up",
        object_space="easting, northing, height, metres; the CRS is not said",
        rotation="matrix a11 to a33, row by row, turns image space into object space (five digits "
        "of metres, twelve of the matrix); when read, the other way round if measured control says "
        "so",
        camera="principal distance in micrometres; distortion and refraction are taken out",
        lost="scans, fiducials, standard deviations, object points of ties; names are numbers "
        "(`names.csv`, ours, keeps them)",
    ),
    holds="film",
    write=write_patb,
    read=read_patb,
    default_name="patb",
)
"""PAT-B, by description."""
