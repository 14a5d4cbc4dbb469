"""Import lists of image measurements: points, tie points and fiducials, all of a list or none.

A measurement of a point that the block knows is a decision. All other points become tie points,
and fiducials those of their scans.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from app.brought_lists import (
    BROUGHT,
    Brought,
    TakenOver,
    known_photos,
    no_scan_of_it,
    ties_name,
    told_strangers,
    write_keys,
    write_lists,
)
from app.exchange_checks import check_measurements
from app.project import ListedScan, Project
from core.block import HAND_SIGMA_PX
from core.exchange import is_laid_upright
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangeTies,
    Pair,
)
from core.formats.measurement_list import (
    AS_WRITTEN,
    MEASUREMENTS,
    MeasuredRow,
    MeasurementReading,
    read_measurement_list,
    ties_of_rows,
)
from core.said import say
from sessions.decisions import Decision, Place


def measured_part(
    project: Project,
    path: Path,
    known_points: Collection[str],
    reading: MeasurementReading = AS_WRITTEN,
) -> TakenOver:
    """What of a list of measurements a block can use.

    Args:
        project: The block.
        path: The list.
        known_points: Points whose measurements are decisions.
        reading: How it is to be read.

    Raises:
        ProjectError: The list cannot be read, knows no scan of the block, measures outside a scan,
            or names a fiducial that its camera does not have.
        ScanError: A scan cannot be opened.
    """
    found = read_measurement_list(path, reading)
    scans = {scan.photo_id: scan for scan in project.scans.listed}
    files = {row.scan: ExchangePhoto(row.scan, row.scan) for row in found.rows}
    foreign = ExchangeBlock(photos=files)
    names = {photo_id.lower(): photo_id for photo_id in scans}
    own = {t: o for t, o in known_photos(foreign, names).items() if not is_laid_upright(t, o)}
    if not own:
        raise no_scan_of_it(path, foreign, names)
    rows = [row for row in found.rows if row.scan in own]
    measured = (ExchangeMeasurement(row.name, row.scan, row.column, row.line) for row in rows)
    paths = {photo_id: scan.path for photo_id, scan in scans.items()}
    check_measurements(ExchangeBlock(measurements=tuple(measured)), own, paths, path)
    notes = list(_notes(found.unused, [scan for scan in files if scan not in own], reading))
    if found.fiducials:
        _check_certified(project, rows, own, scans)
        return _marks(project, path, rows, own, notes)
    return _points(project, path, rows, own, known_points, notes)


def _notes(unused: int, strange: Sequence[str], reading: MeasurementReading) -> list[str]:
    """What of a list is left out, and where its pixels were taken to count from."""
    notes: list[str] = []
    if reading.origin is None:
        notes.append(
            say(
                "Pixels are taken to count from the outer corner of the first pixel. A list that "
                "counts from its middle comes in by gruber import --answer origin=middle."
            )
        )
    if unused:
        notes.append(
            say("{count:# row is|# rows are} not used by the list itself: left out.", count=unused)
        )
    notes += told_strangers(strange)
    return notes


def _check_certified(
    project: Project,
    rows: Sequence[MeasuredRow],
    own: Mapping[str, str],
    scans: Mapping[str, ListedScan],
) -> None:
    """Refuse names that the certificate of a scan's camera does not have."""
    for row in rows:
        name = scans[own[row.scan]].camera
        certified = project.cameras[name].fiducials_mm
        if row.name not in certified:
            raise row.row.refused(
                "Line {number}: camera {camera} has no fiducial {name}.",
                "Name the fiducials in the list as in fiducials_mm of the camera: {names}.",
                camera=name,
                name=row.name,
                names=list(certified),
            )


def _marks(
    project: Project,
    path: Path,
    rows: Sequence[MeasuredRow],
    own: Mapping[str, str],
    notes: Sequence[str],
) -> TakenOver:
    """Fiducials as files of the block."""
    paths = {scan.photo_id: scan.path for scan in project.scans.listed}
    marks: dict[str, dict[str, Pair]] = {}
    for row in rows:
        marks.setdefault(own[row.scan], {})[row.name] = row.column, row.line
    photos = {n: ExchangePhoto(n, paths[n].name, fiducials_px=m) for n, m in marks.items()}

    def write() -> None:
        foreign, same = ExchangeBlock(photos=photos), {name: name for name in photos}
        none = ExchangeTies.none()
        keys = write_lists(project.folder, foreign, same, path, MEASUREMENTS.name, ties=none)
        write_keys(project, keys)

    return TakenOver((), write, Brought({"fiducials": len(photos)}, tuple(notes)))


def _points(
    project: Project,
    path: Path,
    rows: Sequence[MeasuredRow],
    own: Mapping[str, str],
    known_points: Collection[str],
    notes: Sequence[str],
) -> TakenOver:
    """Measurements of known points as decisions, all others as tie points."""
    decisions: tuple[Decision, ...] = tuple(
        Place(row.name, own[row.scan], row.column, row.line, _sigma_px(row))
        for row in rows
        if row.name in known_points
    )
    loose = [row for row in rows if row.name not in known_points]
    ties = ties_of_rows(loose, lambda scan: own[scan])
    told = [*notes, *_of_ties(project, loose, ties, known_points)]

    def write() -> None:
        none = ExchangeBlock()
        keys = write_lists(project.folder, none, {}, path, MEASUREMENTS.name, ties=ties)
        before = project.scans.ties
        if not keys and before == project.folder / BROUGHT / ties_name(MEASUREMENTS.name):
            # An earlier import of this list took for tie points what are surveyed ones now.
            keys["scans", "ties"] = None
        write_keys(project, keys)

    counts = {"measurements": len(decisions), "ties": len(ties.names)}
    kept = {what: count for what, count in counts.items() if count}
    return TakenOver(decisions, write, Brought(kept, tuple(told)))


def _sigma_px(row: MeasuredRow) -> float:
    """Standard deviation of a measurement, that of a hand where nobody says it."""
    return row.sigma_px if row.sigma_px > 0 else HAND_SIGMA_PX


def _of_ties(
    project: Project,
    loose: Sequence[MeasuredRow],
    ties: ExchangeTies,
    known_points: Collection[str],
) -> list[str]:
    """What is to be known of points that became ties."""
    notes: list[str] = []
    alone = {row.name for row in loose} - set(ties.names)
    if alone:
        notes.append(
            say(
                "{count:# point is|# points are} measured in one scan alone and not known to the "
                "block: left out ({names}).",
                count=len(alone),
                names=sorted(alone)[:5],
            )
        )
    if len(ties.names) and not known_points:
        notes.append(
            say(
                "The block has no surveyed points yet, so all of these are tie points. If some are "
                "surveyed, import their coordinates, then this list again."
            )
        )
    if len(ties.names) and project.scans.ties is not None:
        notes.append(
            say("They take the place of the tie points of {file}.", file=project.scans.ties.name)
        )
    return notes
