"""What each verb does, from its parsed arguments to the sentences for the operator."""

import argparse
import json
import os
import shutil
import time
import warnings
import webbrowser
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pyproj
import rasterio
from pyproj.transformer import TransformerGroup

from app.batch import Batch, run_block
from app.bring_points import (
    POINT_TABLE,
    BroughtPoints,
    bring_points,
    reading_of,
    told_lines,
)
from app.check_plan import PlanWish, plan_checks
from app.check_plan import told_lines as told_plan
from app.desk.inputs import desk_inputs
from app.desk.wiring import open_desk
from app.exchange import export_block, import_into
from app.foreign_block import new_from
from app.height_checks import height_doubts
from app.margin import ReadScan, accepted_values, margin_reader, read_scan
from app.new_block import Recognition, recognise, write_block_toml
from app.placing import open_placing, placeable
from app.project import Project, described, read_project
from app.run import STAGE_NAMES, Run, RunOptions
from app.start import open_start, wants_start
from app.teaching import Teacher, find_lessons, open_teaching
from app.terminal import Voice
from core.adjustment.adjusted import AdjustmentReport
from core.errors import ProjectError, StorageError
from core.matching.reference import open_reference
from core.mosaic.comparison import compare_orthos
from core.said import say
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import judge_control, judge_orientations, read_truth
from sessions.atomic_write import whole_file
from sessions.disk import explain_disk_errors
from sessions.products import digest_of
from sessions.session import Session
from ui.web.front import Opened
from ui.words.catalogue import Teller

STAMP = ".demo"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
GIB = 1024**3
LEAST_MEMORY_GIB = 4.0
SPACE_PER_SCAN_GIB = 0.6


def stage_names() -> tuple[str, ...]:
    """Stages in their order, for `--from` and `--until`."""
    return STAGE_NAMES


def run(given: argparse.Namespace, voice: Voice) -> None:
    """The automatic stages."""
    run_block(
        given.block, voice, RunOptions(given.first, given.last, given.workers, given.language)
    )


def run_options(given: argparse.Namespace) -> RunOptions:
    """All stages, as a verb asks that is no run."""
    return RunOptions(workers=given.workers, language=given.language)


def batch(given: argparse.Namespace, voice: Voice) -> None:
    """The automatic stages of many blocks."""
    Batch(given.list, voice).run(given.executor, given.workers, given.scheduler)


def new(given: argparse.Namespace, voice: Voice) -> None:
    """Write the `block.toml` of a folder, and say what was recognised and what was not."""
    if given.format:
        made = new_from(given.folder, given.format, given.project, given.crs, given.operator)
        voice.say(voice.tell("new.written", file=made.file))
        for note in made.notes:
            voice.say(note)
        return
    found = recognise(given.folder)
    read = _read_margins(found, voice) if given.read_margin or given.accept_margin else ()
    accepted = accepted_values(read) if given.accept_margin else {}
    path = write_block_toml(found, accepted=accepted)
    tell = voice.tell
    voice.say(tell("new.written", file=path))
    for name, value in found.found:
        voice.say(tell("new.found", what=tell(f"found.{name}"), value=value))
    for gap in found.gaps:
        values = {"what": tell(f"gap.{gap.name}"), "out": tell(f"gap.out.{gap.out}")}
        voice.say(tell("new.missing", **values))
    for note in found.notes:
        voice.say(tell(f"found.note.{note.name}", **note.values))


def _read_margins(found: Recognition, voice: Voice) -> tuple[ReadScan, ...]:
    """What is written beside the pictures, told scan by scan."""
    reader = margin_reader()
    frame_mm = None if found.frame_mm is None else (found.frame_mm, found.frame_mm)
    scans = sorted({path for name in found.scans for path in found.folder.glob(name)})
    progress, read = voice.stage("margin", voice.tell("margin.read")), []
    for path in scans:
        read.append(read_scan(path, reader, frame_mm, found.scan_pixel_um))
        progress.report(len(read), len(scans), path.name)
    for scan in read:
        for one in scan.fields:
            what = voice.tell(f"margin.{one.name}")
            values = {"scan": scan.path.name, "value": one.value, "text": one.line.text}
            voice.say(voice.tell("margin.found", what=what, **values))
        if not scan.fields:
            voice.say(voice.tell("margin.none", scan=scan.path.name))
    return tuple(read)


def review(given: argparse.Namespace, voice: Voice) -> None:
    """The review desk, until Ctrl-C; what it still lacks is given on pages before it."""
    visit = Visit(given, voice)
    if wants_start(given.block):
        visit.through_start(given.block)
    while visit.through_desk():
        visit.through_start(visit.block)


class Visit:
    """One `gruber review`: pages that follow one another at one address."""

    def __init__(self, given: argparse.Namespace, voice: Voice) -> None:
        self.given, self.voice = given, voice
        self.block: Path = given.block
        self.port: int = given.port
        self.token = ""
        self._opened = bool(given.no_browser)

    def shown(self, page: Opened, said: str) -> None:
        """Say where a page is, and open it in the browser unless one is open there already."""
        self.port, self.token = page.port, page.token
        self.voice.say(said)
        if not self._opened:
            webbrowser.open(page.url)
        self._opened = True

    def through_start(self, folder: Path) -> None:
        """The start page, of one folder after another, until a block has something to review."""
        given = self.given
        while True:
            with open_start(folder, given.host, self.port, given.language, self.token) as page:
                where = "Files, settings and the run: {url}  (Ctrl-C closes)"
                self.shown(page, say(where, url=page.url))
                folder = page.wait()
            if not wants_start(folder):
                self.block = folder
                return

    def through_desk(self) -> bool:
        """The desk, or the placing page before it; True when settings are asked for there."""
        given, project = self.given, read_project(self.block)
        with Session.open(project.folder, given.operator) as session:
            if not self.through_placing(project, session):
                return True
            inputs = desk_inputs(project, session, given.operator, given.host, self.port)
            token = self.token or inputs.token
            with open_desk(replace(inputs, language=given.language, token=token)) as desk:
                opened_at = "The desk is open at {url}  (Ctrl-C closes it; nothing is lost)"
                self.shown(desk, say(opened_at, url=desk.url))
                self.voice.say(
                    say("Guests, who look and decide nothing: {url}", url=desk.guest_url)
                )
                settings = desk.wait()
                ran = desk.ran
        return self.through_desk() if ran else settings

    def through_placing(self, project: Project, session: Session) -> bool:
        """Let a block that does not stand be placed by clicks; False when settings come first."""
        found, given = placeable(project, session), self.given
        if found is None:
            return True
        with open_placing(
            project, found, given.host, self.port, given.language, self.token
        ) as placing:
            self.voice.say("No photo of this block is placed on the reference yet.")
            clicked = (
                "Two points clicked in one photo place it: {url}"
                "  (Ctrl-C closes; what was saved stays)"
            )
            self.shown(placing, say(clicked, url=placing.url))
            return placing.wait()


def report(given: argparse.Namespace, voice: Voice) -> None:
    """The accuracy report of the block as it stands; what is not fresh is computed first."""
    walk = run_block(given.block, voice, run_options(given))
    voice.say(str(walk.session.results / "report.html"))
    for line in signed_lines(walk.session.results / "report.json", voice.tell):
        voice.say(line)


def signed_lines(figures: Path, tell: Teller) -> Iterator[str]:
    """Who has signed the block of a report, and what has changed since."""
    if not figures.is_file():
        return
    written = json.loads(figures.read_text(encoding="utf-8"))
    for one in written["checked"]["signatures"]:
        verdict = tell(f"accepted.{one['verdict']}")
        values = {"verdict": verdict, "who": one["who"], "when": one["when"]}
        values["changed"] = ", ".join(tell(f"signed.part.{name}") for name in one["changed"])
        key = "signed.line.outdated" if one["changed"] else "signed.line"
        yield tell(key, **values, digest=one["digest"])


def export(given: argparse.Namespace, voice: Voice) -> None:
    """The block as it stands in the format of another program; adjusted first where need be."""
    project = read_project(given.block)
    with Session.open(project.folder, "gruber") as session:
        walk = Run(project, session, voice, replace(run_options(given), last="adjustment"))
        walk.walk()
        progress = voice.stage("export", "The block for another program")
        began = time.monotonic()
        report = walk.adjusted
        done = export_block(
            session, report.block, report, given.format, given.out,
            pictures=given.pictures, progress=progress, tangent=given.frame == "tangent",
            taken=project.taken,
        )  # fmt: skip
        voice.ended(
            "export", "The block for another program", time.monotonic() - began, str(done.path)
        )
    for note in done.notes:
        voice.say(note)


def bring(given: argparse.Namespace, voice: Voice) -> None:
    """What another program knows, or a table of points, into a block."""
    name, path = given.source
    project = read_project(given.block, brought=name == POINT_TABLE)
    with Session.open(project.folder, given.operator) as session:
        if name == POINT_TABLE:
            reading = reading_of(given.answer)
            tell_points(bring_points(project, session, Path(path), reading), path, voice)
            return
        brought = import_into(project, session, name, Path(path))
    for what, count in brought.counts.items():
        voice.say(voice.tell(f"brought.{what}", count=count))
    if not brought.counts:
        voice.say(voice.tell("brought.nothing"))
    for note in brought.notes:
        voice.say(note)


def check(given: argparse.Namespace, voice: Voice) -> None:
    """A plan of places to be checked; the block is run as far as it takes to know its ground."""
    project = read_project(given.block)
    with Session.open(project.folder, given.operator) as session:
        if session.products.latest_value("georeference") is None:
            Run(project, session, voice, RunOptions(last="georeference")).walk()
        began, title = time.monotonic(), "Places to be checked"
        progress = voice.stage("check", title)
        wish = PlanWish(given.cells, given.seed, given.points)
        made = plan_checks(project, session, wish, progress)
        voice.ended("check", title, time.monotonic() - began, "")
    for line in told_plan(made):
        voice.say(line)


def tell_points(brought: BroughtPoints, path: Path, voice: Voice) -> None:
    """What came of a table of points.

    Raises:
        ProjectError: A question was left; nothing came in.
    """
    for line in told_lines(brought):
        voice.say(line)
    if brought.recorded is None:
        raise ProjectError(
            path, "no point was taken over.", "Settle what is asked above with --answer."
        )
    voice.say(voice.tell("brought.points", count=len(brought.found.points)))


def demo(given: argparse.Namespace, voice: Voice) -> None:
    """A synthetic block: made, run, compared with its truth, opened."""
    options = SyntheticOptions(given.size, given.epoch, float(given.relief), given.seed)
    make_demo(given.out, options, voice)
    walk = run_block(given.out, voice, run_options(given))
    tell_truth(given.out, walk.adjusted, voice)
    if given.headless:
        voice.say(say("Results: {folder}", folder=str(walk.session.results)))
        voice.say(say("Review:  gruber review {folder}", folder=str(given.out)))
        return
    given.block = given.out
    review(given, voice)


def teach(given: argparse.Namespace, voice: Voice) -> None:
    """The lessons, until Ctrl-C, or only their names."""
    found = find_lessons(given.own)
    if given.list:
        told = Teacher(found).listed(voice.tell.language)["words"]
        for name in found:
            voice.say(voice.tell("teach.line", name=name, title=told[f"lesson.{name}.title"]))
        return
    with open_teaching(found, given.host, given.port, given.language) as page:
        url = f"{page.url}&lesson={given.lesson}" if given.lesson else page.url
        voice.say(voice.tell("teach.open", url=url))
        if not given.no_browser:
            webbrowser.open(url)
        page.wait()


def lesson_names(own: Path | None = None) -> tuple[str, ...]:
    """Names of the lessons, for `--lesson`."""
    return tuple(find_lessons(own))


def doctor(given: argparse.Namespace, voice: Voice) -> None:
    """What this machine, and a block, lack."""
    for finding in examine(given.block):
        voice.say(finding)


def make_demo(folder: Path, options: SyntheticOptions, voice: Voice) -> None:
    """Make the block, unless this very block is there already.

    Raises:
        StorageError: The folder holds something else, or cannot be written.
    """
    stamp, digest = folder / STAMP, digest_of("demo", 1, options)
    if stamp.is_file():
        if stamp.read_text(encoding="utf-8") == digest:
            return
        raise StorageError(
            folder,
            "holds a demo block with other options.",
            "Give another folder with --out, or remove this one.",
        )
    if folder.is_dir() and (folder / "block.toml").exists():
        raise StorageError(
            folder, "holds a block that is not a demo.", "Give another folder with --out."
        )
    started = time.monotonic()
    progress = voice.stage("make", "A landscape, a flight, film")
    with explain_disk_errors(folder):
        make_block(folder, options, progress)
    with whole_file(stamp) as temporary:
        temporary.write_text(digest, encoding="utf-8")
    voice.ended("make", "A landscape, a flight, film", time.monotonic() - started, str(folder))


def tell_truth(folder: Path, report: AdjustmentReport, voice: Voice) -> None:
    """Compare a demo's results with the truth that was put in, and say so in a table."""
    for line in truth_lines(folder, report):
        voice.say(line)


def truth_lines(folder: Path, report: AdjustmentReport) -> list[str]:
    """The comparison with truth, a line for each figure."""
    truth = read_truth(folder)
    control = judge_control(truth, report.block)
    photos = judge_orientations(truth, report.block)
    mosaic = compare_orthos(
        folder / "results" / "mosaic.tif", folder / "truth" / "archival_ortho.tif"
    )
    oriented = sum(photo.oriented for photo in report.block.photos.values())
    ground = float(np.sqrt(np.mean(np.square(photos.ground_m))))
    return [
        "",
        "Against the truth that was put in",
        f"  photos oriented          {oriented} of {len(report.block.photos)}",
        f"  mosaic m_p               {mosaic.m_p:.2f} m  "
        f"(m_X {mosaic.m_x:.2f}, m_Y {mosaic.m_y:.2f}, {mosaic.n} places)",
        f"  orientation, on ground   {ground:.2f} m rms over the frames",
        f"  control measurements     {control.used} used, "
        f"{100 * control.wrong_share:.1f} % wrong (more than 3 m off)",
        f"  sigma nought             {report.sigma_nought:.2f}",
        "",
    ]


def examine(block: Path | None) -> Iterator[str]:
    """Findings on the machine, then on a block; a line that begins with `!` needs attention."""
    yield f"GDAL {rasterio.__gdal_version__}, PROJ {pyproj.proj_version_str}"
    yield from drivers()
    yield from grids()
    browser = next((name for name in BROWSERS if shutil.which(name)), None)
    yield (
        say("Browser: {browser}", browser=browser)
        if browser
        else "! No browser found: open the desk's address by hand"
    )
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GIB
    yield attention(
        say(
            "Memory: {memory:.0f} GiB ({enough:.0f} GiB are enough for any scan)",
            memory=memory, enough=LEAST_MEMORY_GIB,
        ),
        memory < LEAST_MEMORY_GIB,
    )  # fmt: skip
    yield say("Processors: {count}", count=os.cpu_count() or 1)
    if block is not None:
        yield from of_block(block)


def attention(finding: str, needed: bool = True) -> str:
    """A finding, marked where it needs attention."""
    return say("! {finding}", finding=finding) if needed else finding


def drivers() -> Iterator[str]:
    """Raster and vector formats that archives use."""
    with rasterio.Env() as env:
        known = env.drivers()
    for name, use in (("GTiff", "TIFF"), ("JP2OpenJPEG", "JPEG 2000"), ("COG", "mosaics")):
        if name not in known:
            yield say("! GDAL has no driver {name} ({use})", name=name, use=use)
    for name in ("ESRI Shapefile", "GPKG", "GeoJSON"):
        if name not in pyogrio.list_drivers():
            yield say("! GDAL has no vector driver {name}", name=name)


def grids() -> Iterator[str]:
    """The grids that heights and datums of Czechia need."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is missing is told below, in our words
        group = TransformerGroup("EPSG:5514+8357", "EPSG:4937", always_xy=True)
    if not group.best_available:
        yield (
            "! PROJ lacks the grids for S-JTSK and Bpv heights: keep reference and control in one "
            "CRS (nothing is then transformed), or install them with projsync"
        )


def of_block(block: Path) -> Iterator[str]:
    """What a block lacks: files, space for its results."""
    project = read_project(block)
    given = described(project)
    reference = open_reference(given.reference)
    told = "Block {name}: {count:# scan|# scans}, {crs}"
    yield say(told, name=given.name, count=len(given.scans), crs=given.crs)
    if not given.reference.ortho:
        yield "No reference ortho: nothing is proposed; measure your own points at the desk"
    else:
        gsd = reference.ortho.ground_sample_distance_m
        dem = reference.dem.ground_sample_distance_m
        yield say("Reference: ortho {gsd:g} m, DEM {dem:g} m", gsd=gsd, dem=dem)
    if not given.reference.dem:
        yield "! No DEM: the ground is taken as level, and orthos are off by the relief"
    if given.reference.ortho and not given.reference.roads:
        yield "No road layers: control comes from salient points of the ortho alone"
    if not all(given.cameras[scan.camera].fiducials_mm for scan in given.scans):
        yield (
            "! Some cameras have no fiducials_mm: their marks are looked for, and placed by all "
            "photos together"
        )
    for doubt in height_doubts(project, given.surveyed, reference.dem):
        yield attention(doubt.message)
    free = shutil.disk_usage(project.folder).free / GIB
    needed = SPACE_PER_SCAN_GIB * len(given.scans)
    disk = "Disk: {free:.1f} GiB free, about {needed:.1f} GiB needed"
    yield attention(say(disk, free=free, needed=needed), free <= needed)
