"""`gruber export` and `gruber import`: write a block for other programs, read their files."""

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from app.answers import eo_heads, measurement_reading
from app.bring_measurements import measured_part
from app.bring_points import (
    POINT_TABLE,
    OpenQuestionsError,
    bring_points,
    known_block,
    points_of,
    reading_of,
    told_lines,
)
from app.brought_lists import (
    Brought,
    TakenOver,
    known_photos,
    no_scan_of_it,
    told_strangers,
    write_keys,
    write_lists,
)
from app.exchange_checks import (
    check_exteriors,
    check_measurements,
    on_scans,
    without_known,
)
from app.project import Project
from core.adjustment.adjusted import AdjustmentReport
from core.block import HAND_SIGMA_PX, Block, SurveyedPoint
from core.errors import CrsError, StorageError
from core.exchange import (
    UPRIGHT_SUFFIX,
    fit_to_format,
    named_upright,
    upright_frame,
    upright_photos,
)
from core.formats.eo_format import EO_READERS
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeFormat,
    ExchangePoint,
    ExchangeTies,
    read_format,
)
from core.formats.exchange_formats import FORMATS
from core.formats.listed_point import USUAL_SIGMA_M, ListedPoint
from core.formats.measurement_list import MEASUREMENTS
from core.formats.tangent_frame import in_tangent_frame
from core.geometry.crs import operation_between, read_crs
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, rotation_from_angles
from core.progress import Part, Progress
from core.raster.upright import write_upright
from core.said import say
from sessions.atomic_write import whole_file, whole_folder
from sessions.decisions import BringPoints, Decision, Place
from sessions.disk import explain_disk_errors
from sessions.session import Session

EXPORTS = "export"
"""Folder of the results for what goes out."""
PLAIN_EO = "eo"
"""The format of lists that say how they count; others are asked about."""
PICTURES = "photos"
"""Folder of an export with the scans laid upright."""
STAMP = ".export"
"""File of an exported folder that names all that was written into it."""


def format_named(name: str, *, reads: bool) -> ExchangeFormat:
    """A format by its name; raises ValueError where there is none, with those there are."""
    names = format_names(reads=reads)
    if name not in names:
        raise ValueError(f"{name!r} is no format; it is one of {', '.join(names)}")
    return FORMATS[name]


def format_names(*, reads: bool) -> tuple[str, ...]:
    """Formats that can be read, or written."""
    return tuple(
        name for name, form in FORMATS.items() if (form.read if reads else form.write) is not None
    )


@dataclass(frozen=True, slots=True)
class Exported:
    """What an export wrote."""

    path: Path
    """File or folder."""
    notes: tuple[str, ...]
    """What was left out or is to be known, a sentence each."""


def export_block(
    session: Session,
    block: Block,
    report: AdjustmentReport | None,
    name: str,
    out: Path | None,
    *,
    pictures: bool,
    progress: Progress,
    tangent: bool = False,
    taken: Mapping[str, str] = MappingProxyType({}),
) -> Exported:
    """Write a block in a foreign format, whole or not at all.

    Args:
        session: Where results are kept.
        block: The block as it stands.
        report: Its adjustment.
        name: The format.
        out: Where to; None for `results/export/NAME`.
        pictures: Whether the scans go along, laid upright, where the format needs that.
        progress: Told per scan.
        tangent: Whether coordinates are those of a local tangent frame instead of the map.
        taken: Day, month or year of exposure by photo.

    Raises:
        StorageError: The disk is full or may not be written, or something else stands there.
        CrsError: The block's CRS has no way to a tangent frame.
    """
    form = format_named(name, reads=False)
    assert form.write is not None
    target = export_target(session, name, out)
    left = fit_to_format(block, report, replace(form, curved=True) if tangent else form)
    if taken:
        days = {k: replace(p, taken=taken.get(k, "")) for k, p in left.photos.items()}
        left = replace(left, photos=days)
    if tangent:
        left, _ = in_tangent_frame(left)
    if form.holds == "upright":
        left = named_upright(left, upright_photos(block))
    if form.folder:
        with whole_folder(target) as temporary:
            notes = form.write(temporary, left)
            if pictures and form.holds == "upright":
                _write_pictures(block, temporary / PICTURES, progress)
            (temporary / STAMP).write_bytes(os.fsencode("\n".join(_files_in(temporary))))
    else:
        with whole_file(target) as temporary:
            notes = form.write(temporary, left)
    return Exported(target, (*left.notes, *notes, *_pictures_note(block, form, pictures)))


def export_target(session: Session, name: str, out: Path | None) -> Path:
    """Where an export goes; a folder is replaced whole, so it may hold only what an export wrote.

    A file is replaced outside the block, where its name ends as those of the format.

    Raises:
        StorageError: Something else stands there.
    """
    form = format_named(name, reads=False)
    if out is None:
        target = session.results / EXPORTS / (form.default_name or name)
    else:
        target = out.resolve()
    if not form.folder and out is not None and target.is_file():
        usual = Path(form.default_name or name).suffix
        exports = (session.results / EXPORTS).resolve()
        own = target.is_relative_to(session.folder.resolve())
        if target.suffix != usual or (own and not target.is_relative_to(exports)):
            another = "Name another file, or move away what stands there."
            raise StorageError(target, "is already there, and may not be an export.", another)
    # What stands in the results without a stamp was exported by an earlier version.
    if not form.folder or not target.exists() or (out is None and not (target / STAMP).exists()):
        return target
    another = "Name another folder, or move away what stands there."
    if not target.is_dir():
        raise StorageError(target, "is a file; this format is a folder of several.", another)
    if Path.cwd().is_relative_to(target):
        raise StorageError(target, "is the folder you are in; an export replaces it.", another)
    with explain_disk_errors(target):
        stamp = target / STAMP
        known = os.fsdecode(stamp.read_bytes()).split("\n") if stamp.exists() else []
        tops = {STAMP, *(name.partition("/")[0] for name in known)}
        others = {one.name for one in target.iterdir()} - tops
        others = others or {*_files_in(target)} - {STAMP, *known}
    if others:
        raise StorageError(
            target, "holds {name}, which no export wrote.", another, name=min(others)
        )
    return target


def _files_in(folder: Path) -> list[str]:
    """Everything in a folder and below but folders, by its path there."""
    return [
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_symlink() or not path.is_dir()
    ]


def _write_pictures(block: Block, folder: Path, progress: Progress) -> None:
    """Every scan laid upright."""
    folder.mkdir()
    photos = list(block.photos.values())
    for done, photo in enumerate(photos):
        frame = upright_frame(photo, block.camera_of(photo.photo_id))
        part = Part(progress, done / len(photos), (done + 1) / len(photos))
        if frame is not None:
            write_upright(
                photo.scan,
                folder / f"{photo.scan.stem}{UPRIGHT_SUFFIX}.tif",
                photo.interior,
                (frame.size_px, frame.pixel_mm, frame.corner_mm),
                part,
            )


def _pictures_note(block: Block, form: ExchangeFormat, pictures: bool) -> tuple[str, ...]:
    """A word on pixels that are not those of the scans."""
    laid = sorted(upright_photos(block)) if form.holds == "upright" else []
    if not laid or pictures:
        return ()
    return (
        say(
            "Pixels are those of the scans laid upright on their fiducials, which are called "
            "{name} and so on here; --pictures writes these as well.",
            name=f"{laid[0]}{UPRIGHT_SUFFIX}",
        ),
    )


def _known(block: Block) -> ExchangeBlock:
    """What the block knows of its photos, by which a list of orientations is judged."""
    known = fit_to_format(block, None, FORMATS[PLAIN_EO])
    photos = {n: replace(p, exterior=block.photos[n].exterior) for n, p in known.photos.items()}
    return replace(known, photos=photos)


def bring_file(
    project: Project, session: Session, name: str, path: Path, answers: Sequence[str] = ()
) -> Brought:
    """Take over a table of points, or what this block can use of a file of another program.

    Args:
        project: The block.
        session: Its session.
        name: The format; `points` for a table, which is read in the block's CRS.
        path: The file or folder.
        answers: Answers to what a table leaves open, such as `refused=leave out`.

    Raises:
        OpenQuestionsError: A table leaves something to be asked; nothing came in.
        PhotogrammetryError: The file cannot be used.
    """
    if name != POINT_TABLE:
        return import_into(project, session, name, path, answers)
    brought = bring_points(project, session, path, reading_of(answers))
    told = tuple(told_lines(brought))
    if brought.recorded is None and (brought.found.questions or brought.found.refused):
        raise OpenQuestionsError(path, told)
    return Brought({"points": len(brought.found.points)}, told)


def import_into(
    project: Project, session: Session, name: str, path: Path, answers: Sequence[str] = ()
) -> Brought:
    """Take over from a foreign file what this block can use; raises as `usable_part`.

    `answers` say how a list is to be read, such as `columns=scan,X,Y,Z`.
    """
    block = known_block(project, session)
    points = points_of(project, session, block)
    if name == MEASUREMENTS.name:
        taken = measured_part(project, path, points, measurement_reading(answers))
    else:
        taken = usable_part(project, name, path, block, points, eo_heads(name, answers))
    before = project.file.read_bytes()
    taken.write()
    try:
        if taken.decisions:
            session.record_all(taken.decisions)
    except Exception:
        # All of a file comes in, or nothing: without its names in block.toml a list is none.
        with whole_file(project.file) as temporary:
            temporary.write_bytes(before)
        raise
    return taken.brought


def usable_part(
    project: Project,
    name: str,
    path: Path,
    block: Block | None,
    points: Mapping[str, SurveyedPoint],
    heads: Sequence[str] = (),
) -> TakenOver:
    """What of a foreign file a block can use.

    Args:
        project: The block's `block.toml`.
        name: The format.
        path: The file or folder.
        block: The block as far as it was run, by which orientations and pixels are judged; None
            where nothing places its photos yet.
        points: All points of the block, listed and brought ones among them.
        heads: Columns of a list of orientations, where somebody said them.

    Raises:
        PhotogrammetryError: The file cannot be read, is in a CRS that cannot be brought into the
            block's, knows none of its scans, or says what cannot be.
    """
    form, held = format_named(name, reads=True), bool(project.reference.ortho)
    if block is not None and block.crs != project.block.crs:
        block = None
    if name in EO_READERS:
        # A list that says how it counts may correct the one that alone placed the photos.
        known = _known(block) if block is not None and (held or name == PLAIN_EO) else None
        form = replace(form, read=partial(EO_READERS[name], known=known, heads=heads))
    read = read_format(form, path)
    foreign = in_block_crs(read, project.block.crs, path)
    names = {scan.photo_id.lower(): scan.photo_id for scan in project.scans.listed}
    own = known_photos(foreign, names)
    if foreign.photos and not own:
        raise no_scan_of_it(path, foreign, names)
    foreign = on_scans(foreign, own, block, path)
    unknown = {m.point_id for m in foreign.measurements} - {*foreign.points, *points}
    foreign, kept = without_known(foreign, points, path)
    check_measurements(foreign, own, {s.photo_id: s.path for s in project.scans.listed}, path)
    elsewhere = check_exteriors(foreign, own, block, held, path)
    decisions = decisions_of(foreign, own, path.name)

    def write() -> None:
        none = ExchangeTies.none()
        write_keys(project, write_lists(project.folder, foreign, own, path, name, ties=none))

    counts = {
        "points": len(foreign.points),
        "measurements": sum(isinstance(one, Place) for one in decisions),
        "exteriors": sum(foreign.photos[theirs].exterior is not None for theirs in own),
        "positions": sum(foreign.photos[theirs].position is not None for theirs in own),
        "fiducials": sum(bool(foreign.photos[theirs].fiducials_px) for theirs in own),
    }
    brought = Brought(
        {what: count for what, count in counts.items() if count},
        (*foreign.notes, *kept, *elsewhere, *_left_out(foreign, own, unknown)),
    )
    return TakenOver(decisions, write, brought)


def in_block_crs(foreign: ExchangeBlock, crs: str, path: Path) -> ExchangeBlock:
    """Points, positions and orientations in the block's CRS; heights stay as they are.

    A projection turns the axes: photos turn by the angle between both grid norths.

    Raises:
        CrsError: A CRS that is not known, or orientations in one that is no map projection.
    """
    if not foreign.crs or read_crs(foreign.crs, path) == read_crs(crs, path):
        return foreign
    placed = {n: p.centre for n, p in foreign.photos.items() if p.centre is not None}
    oriented = any(photo.exterior is not None for photo in foreign.photos.values())
    if oriented and not read_crs(foreign.crs, path).is_projected:
        raise CrsError(
            path,
            "its orientations are in {theirs}, which is no map projection.",
            "Export them in {ours}.",
            theirs=foreign.crs,
            ours=crs,
        )
    places = [point.position for point in foreign.points.values()]
    places += placed.values()
    plan = np.array(places).reshape(-1, 3)[:, :2]
    operation = operation_between(foreign.crs, crs, plan, path)
    moved = operation.forward(plan)
    # design: over a kilometre a projection is a turn to a hundredth of a second of arc.
    step = np.array([1000.0 if oriented else 0.0, 0.0])
    ahead = operation.forward(plan + step) - moved
    turns = np.arctan2(ahead[:, 1], ahead[:, 0])
    count = len(foreign.points)
    points = {
        name: replace(point, position=(float(east), float(north), point.position[2]))
        for (name, point), (east, north) in zip(foreign.points.items(), moved[:count], strict=True)
    }
    photos = dict(foreign.photos)
    for (name, (*_, height)), (east, north), turn in zip(
        placed.items(), moved[count:], turns[count:], strict=True
    ):
        exterior = photos[name].exterior
        if exterior is None:
            photos[name] = replace(photos[name], position=(float(east), float(north), height))
            continue
        # R_omega R_phi R_kappa turned about the vertical; angles of the whole are taken anew.
        turned = rotation_from_angles(0.0, 0.0, float(turn)) @ exterior.object_from_image
        centre = np.array([east, north, height])
        moved_exterior = ExteriorOrientation(centre, *angles_from_rotation(turned))
        photos[name] = replace(photos[name], exterior=moved_exterior)
    return replace(foreign, crs=crs, points=points, photos=photos)


def decisions_of(
    foreign: ExchangeBlock, own: Mapping[str, str], source: str
) -> tuple[Decision, ...]:
    """Points and their measurements as decisions."""
    made: list[Decision] = []
    if foreign.points:
        made.append(BringPoints(tuple(map(listed, foreign.points.values())), source))
    made += [
        Place(one.point_id, own[one.photo_id], one.column, one.row, one.sigma_px or HAND_SIGMA_PX)
        for one in foreign.measurements
        if one.photo_id in own and not foreign.on_film
    ]
    return tuple(made)


def listed(point: ExchangePoint) -> ListedPoint:
    """A foreign point as one of the user's own."""
    sigma = point.sigma_m or (USUAL_SIGMA_M, USUAL_SIGMA_M, USUAL_SIGMA_M)
    return ListedPoint(point.point_id, *point.position, sigma, point.role)


def _left_out(
    foreign: ExchangeBlock, own: Mapping[str, str], without_place: Collection[str]
) -> tuple[str, ...]:
    """What this block has no place for; measured points may have no coordinates."""
    notes: list[str] = []
    if without_place and not foreign.on_film:
        notes.append(
            say(
                "{count:# measured point has|# measured points have} no coordinates: they count "
                "once a list brings these ({names}).",
                count=len(without_place),
                names=sorted(without_place)[:5],
            )
        )
    if foreign.on_film:
        notes.append(
            say("Measurements on film are not taken over: the program does not know the scans.")
        )
    notes += told_strangers([name for name in foreign.photos if name not in own])
    if len(foreign.ties.point):
        notes.append(say("Tie points are not taken over; the run measures its own in the scans."))
    if foreign.cameras:
        notes.append(say("The cameras of block.toml stay as they are."))
    return tuple(notes)
