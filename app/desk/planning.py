"""A plan of the checks, drawn at the desk."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aiohttp import web

from app.check_plan import PlanWish, draw_plan
from app.desk.messages import Measured
from app.project import read_project
from sessions.session import Session
from ui.review.state import Notice
from ui.web.running import operators_only, told


def plan_route(folder: Path, hand_in: Callable[[Measured], None]) -> web.RouteDef:
    """Draws places, as many as the standard asks for, and hands the decision to the loop."""

    async def plan(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        seat_id = request.query.get("seat", "")
        return await asyncio.to_thread(told, lambda: hand_in_plan(folder, seat_id, hand_in))

    return web.post("/checks/plan", plan)


def hand_in_plan(folder: Path, seat_id: str, hand_in: Callable[[Measured], None]) -> dict[str, Any]:
    """Draw a plan; what was drawn, for the page.

    Raises:
        PhotogrammetryError: There is nothing to draw on.
    """
    # The loop's own session is not to be used from here.
    with Session.open(folder, "") as session:
        made = draw_plan(read_project(folder), session, PlanWish())
    notice = Notice("notice.planned", {"count": f"{len(made.plan.places)}"})
    hand_in(Measured(seat_id, made.plan, notice))
    return {"places": len(made.plan.places)}
