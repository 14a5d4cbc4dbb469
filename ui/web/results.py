"""Tables and report over HTTP, to be read and taken away from the desk."""

import re
from pathlib import Path

from aiohttp import web

PLAIN_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,80}")
CONTENT = {
    ".csv": "text/csv", ".html": "text/html", ".json": "application/json", ".tif": "image/tiff",
    ".gpkg": "application/geopackage+sqlite3",
}  # fmt: skip
FIRST = {".html": 0, ".tif": 1}
"""What is looked for most stands first: the report, then the mosaic."""
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
)
"""The report needs nothing but itself."""


def result_routes(folder: Path | None) -> list[web.RouteDef]:
    """A list of what there is, and each file; none where there is no folder."""
    if folder is None:
        return []

    async def listed(request: web.Request) -> web.StreamResponse:
        found = sorted(_files(folder), key=lambda path: FIRST.get(path.suffix, len(FIRST)))
        return web.json_response([[path.name, path.stat().st_size] for path in found])

    async def one(request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        found = next((path for path in _files(folder) if path.name == name), None)
        if found is None:
            raise web.HTTPNotFound(text="There is no such result.")
        headers = {"Content-Type": CONTENT[found.suffix], "Cache-Control": "no-cache"}
        if found.suffix == ".html":
            headers["Content-Security-Policy"] = REPORT_POLICY
        else:
            headers["Content-Disposition"] = f'attachment; filename="{found.name}"'
        return web.FileResponse(found, headers=headers)

    return [web.get("/results/", listed), web.get("/results/{name}", one)]


def _files(folder: Path) -> list[Path]:
    """Plain files with a plain name directly in the folder, no links."""
    if not folder.is_dir():
        return []
    return sorted(
        path
        for path in folder.iterdir()
        if PLAIN_NAME.fullmatch(path.name)
        and path.suffix in CONTENT
        and path.is_file()
        and not path.is_symlink()
    )
