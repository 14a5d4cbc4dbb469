"""A plan of the checks, and a sample of the map sheets, drawn at the desk."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from aiohttp import web

from app.check_plan import MadePlan, PlanWish, draw_plan
from app.desk.messages import Measured
from app.project import read_project
from app.sheet_sample import draw_sample
from core.errors import Cancelled, PhotogrammetryError
from sessions.session import Session
from sessions.sheet_samples import sample_of, standing_samples
from ui.review.state import Notice
from ui.web.front import as_json
from ui.web.running import operators_only, told

TOLD_EVERY_S = 0.25
"""So often a page is told how far its plan is, and it is noticed that nobody waits for it."""


class Drawing:
    """How far a plan is; satisfies `core.progress.Progress`."""

    def __init__(self) -> None:
        self.grid, self.share, self.stopped = 0, 0.0, False

    def report(self, done: float, total: float, what: str = "") -> None:
        """Take a report; raises `Cancelled` once nobody waits for the plan."""
        if self.stopped:
            raise Cancelled
        # A grid that gives too few places is followed by a finer one.
        self.grid += not done
        self.share = done / total if total else 0.0


def plan_route(folder: Path, hand_in: Callable[[Measured], None]) -> web.RouteDef:
    """Draws places, as many as the standard asks for, and hands the decision to the loop.

    The answer is a line for each step. A page that stops listening has the drawing stopped, and
    nothing is handed in.
    """

    async def plan(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        answer = web.StreamResponse(headers={"Cache-Control": "no-store"})
        await answer.prepare(request)

        async def tell(said: dict[str, Any]) -> None:
            await answer.write(as_json(said).encode() + b"\n")

        drawing = Drawing()
        work = asyncio.ensure_future(asyncio.to_thread(_drawn, folder, drawing))
        # What is left behind ends later, and nobody asks what came of it.
        work.add_done_callback(lambda done: done.cancelled() or done.exception())
        with suppress(ConnectionError):
            try:
                while not work.done():
                    await tell({"grid": drawing.grid, "share": round(drawing.share, 3)})
                    await asyncio.wait({work}, timeout=TOLD_EVERY_S)
                made = work.result()
                await tell({"places": made.plan.count})
                notice = Notice("notice.planned", {"count": f"{made.plan.count}"})
                hand_in(Measured(request.query.get("seat", ""), made.plan, notice))
            except PhotogrammetryError as error:
                await tell({"error": error.told})
            finally:
                drawing.stopped = True
        return answer

    return web.post("/checks/plan", plan)


def sample_route(folder: Path, hand_in: Callable[[Measured], None]) -> web.RouteDef:
    """Draws a sample of the map sheets and hands the decision to the loop.

    `seen` is the digest of the sample that it replaces: nobody replaces one that is not shown.
    """

    async def draw(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        seat, seen = request.query.get("seat", ""), request.query.get("seen", "")

        def drawn() -> dict[str, int]:
            with Session.open(folder, "") as session:
                others = standing_samples(session.decisions())
                if seen != (sample_of(others[-1]).digest if others else ""):
                    cause = "has another sample of its map sheets by now; none was drawn."
                    raise PhotogrammetryError(folder, cause, "Look at it first.")
                sample = draw_sample(read_project(folder), session)
            notice = Notice("notice.sampled", {"count": f"{sample.count}"})
            hand_in(Measured(seat, sample, notice))
            return {"sheets": sample.count}

        return await asyncio.to_thread(told, drawn)

    return web.post("/checks/sheets", draw)


def _drawn(folder: Path, drawing: Drawing) -> MadePlan:
    # The loop's own session is not to be used from here.
    with Session.open(folder, "") as session:
        return draw_plan(read_project(folder), session, PlanWish(), drawing)
