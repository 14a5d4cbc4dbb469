"""How a wheel is built: everything in it lies inside the package `gruber`.

A checkout has its rooms side by side (`app`, `core`, `ui`, `sessions`), under names that others
use too. In a wheel they are `gruber.app` and so on: the build puts them there and says so in every
import. It costs this file, and that a traceback of an installed program says `gruber.core` where
the checkout has `core`. An editable installation is left as it is.
"""

import ast
import shutil
from pathlib import Path

from setuptools.command.build_py import build_py

ROOMS = ("app", "core", "ui", "sessions")


class InsideGruber(build_py):
    """`build_py` that moves the rooms into `gruber`."""

    def run(self) -> None:
        """Build as usual, then move and rewrite; nothing is moved for an editable installation."""
        super().run()
        if self.editable_mode:
            return
        inside = Path(self.build_lib) / "gruber"
        (inside / Path(__file__).name).unlink(missing_ok=True)
        for room in ROOMS:
            shutil.rmtree(inside / room, ignore_errors=True)
            shutil.move(inside.parent / room, inside / room)
        for path in inside.rglob("*.py"):
            path.write_text(with_imports_inside(path.read_text("utf-8"), str(path)), "utf-8")


def with_imports_inside(source: str, name: str) -> str:
    """A module whose imports of the rooms go to `gruber`.

    Args:
        source: The module's text.
        name: Its file, for errors.

    Raises:
        SyntaxError: It imports a room by `import core.block`, whose uses could not be renamed.
    """
    lines = source.splitlines(keepends=True)
    for node in ast.walk(ast.parse(source, name)):
        if isinstance(node, ast.Import):
            roomy = [alias.name for alias in node.names if alias.name.split(".")[0] in ROOMS]
            if roomy:
                raise SyntaxError(f"{name}:{node.lineno}: write `from ... import`, not {roomy}")
        elif isinstance(node, ast.ImportFrom) and _is_room(node):
            line = lines[node.lineno - 1]
            lines[node.lineno - 1] = line.replace("from ", "from gruber.", 1)
    return "".join(lines)


def _is_room(node: ast.ImportFrom) -> bool:
    return node.level == 0 and str(node.module).split(".")[0] in ROOMS
