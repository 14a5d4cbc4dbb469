"""The unused part of a scan, drawn as a transparent overlay."""

import asyncio

import cv2
import numpy as np
from aiohttp import web

from core.arrays import Mask
from ui.review.state import InitialState

VEIL = (0, 190, 255, 90)
"""Blue, green, red and alpha of what is left out."""


def mask_route(initial: InitialState) -> web.RouteDef:
    """The veil of a scan as a PNG of cells that cover it whole."""

    async def veil(request: web.Request) -> web.StreamResponse:
        film = initial.films.get(request.match_info["photo"])
        usable = None if film is None else film.scan.usable
        if usable is None:
            raise web.HTTPNotFound(text="No mask is known of this scan.")
        body = await asyncio.to_thread(as_veil, usable.mask)
        headers = {"Cache-Control": "private, max-age=86400"}
        return web.Response(body=body, content_type="image/png", headers=headers)

    return web.get("/mask/{photo}", veil)


def as_veil(usable: Mask) -> bytes:
    """PNG, clear where the scan may be used."""
    picture = np.zeros((*usable.shape, 4), dtype=np.uint8)
    picture[~usable] = VEIL
    done, data = cv2.imencode(".png", picture)
    assert done
    return np.asarray(data).tobytes()
