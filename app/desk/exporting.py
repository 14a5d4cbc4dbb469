"""Export at the desk: the adjusted block in the format of another program, as one download."""

import asyncio
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aiohttp import web

from app.desk.background import Adjust
from app.desk.watched_job import WatchedJob
from app.exchange import Exported, export_block, format_names
from app.project import Project
from core.adjustment.adjusted import AdjustmentReport
from core.block import Block
from core.errors import Cancelled, ProjectError
from core.formats.exchange_formats import FORMATS
from core.progress import Progress
from sessions.atomic_write import whole_file
from sessions.session import RESULTS, Session
from ui.review.state import InitialState
from ui.web.running import json_of, operators_only, told


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """What the desk shows: its block with the decisions that stand, adjusted as it adjusts."""

    block: Block
    """As the engine left it."""
    initial: InitialState
    """What the photos began from."""
    adjust: Adjust
    """(block, progress) -> report."""

    def __call__(self, session: Session, progress: Progress) -> AdjustmentReport:
        """Nothing of the engine is made again for it."""
        block = session.replayed(self.block, self.initial.films, self.initial.cameras)
        return self.adjust(block, progress)


def standing_export(
    project: Project, standing: Standing, name: str, pictures: bool, progress: Progress
) -> Exported:
    """The block as all decisions leave it, in `results/export`; `progress` may stop it."""
    with Session.open(project.folder, "gruber") as session:
        report = standing(session, progress)
        return export_block(
            session, report.block, report, name, None, pictures=pictures, progress=progress,
            taken=project.taken,
        )  # fmt: skip


def zip_folder(folder: Path) -> Path:
    """A folder as one file beside it."""
    target = folder.with_name(f"{folder.name}.zip")
    with whole_file(target) as temporary:
        shutil.make_archive(str(temporary.with_suffix("")), "zip", folder)
    return target


def titles() -> Mapping[str, str]:
    """Formats that can be written, with what a user calls them."""
    return {name: FORMATS[name].title for name in format_names(reads=False)}


def upright_formats() -> list[str]:
    """Formats whose pixels are those of scans laid upright."""
    return [name for name in titles() if FORMATS[name].holds == "upright"]


def export_routes(project: Project, standing: Standing) -> tuple[web.RouteDef, ...]:
    """`/export`: how far one is, for everybody; writing and stopping it, for operators."""
    file, remedy = project.folder / "block.toml", "Wait for it, or cancel it."
    job = WatchedJob(ProjectError(file, "is being exported.", remedy))

    def write(name: str, pictures: bool) -> dict[str, Any]:
        with job.begun():
            try:
                done = standing_export(project, standing, name, pictures, job)
            except Cancelled:
                return {}
            file = done.path if done.path.is_file() else zip_folder(done.path)
        inside = file.relative_to(project.folder / RESULTS).as_posix()
        return {"file": inside, "notes": done.notes}

    async def export(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        name = request.match_info["name"]
        if name not in titles():
            raise web.HTTPNotFound
        pictures = bool((await json_of(request)).get("pictures"))
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(None, lambda: told(lambda: write(name, pictures)))

    return (*job.routes("/export"), web.post("/export/{name}", export))
