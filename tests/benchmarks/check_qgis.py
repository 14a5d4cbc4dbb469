"""Open a block's QGIS project with QGIS's own Python, and say of every layer whether it stands.

`python tests/benchmarks/check_qgis.py BLOCK/results/block.qgs`, with the Python that QGIS came for
(on Debian /usr/bin/python3 after `apt install python3-qgis`). Exit code 0 where all layers are
valid, in the project's CRS and styled; 1 where one is not; 2 where QGIS is missing.
"""

import os
import sys
from pathlib import Path


def tell(line: str) -> None:
    """One line to the terminal."""
    sys.stdout.write(f"{line}\n")


def main(path: Path) -> int:
    """What QGIS says of a project, a line a layer."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    try:
        from qgis.core import QgsApplication, QgsProject  # pyright: ignore
    except ImportError:
        tell("QGIS is missing: nothing was checked. Install python3-qgis and use its Python.")
        return 2
    application = QgsApplication([], False)
    application.initQgis()
    project = QgsProject.instance()
    if not project.read(str(path)):
        tell(f"{path}: QGIS cannot read it.")
        return 1
    crs = project.crs().authid()
    layers = project.mapLayers().values()
    wrong = 0
    for layer in layers:
        styled = layer.renderer() is not None
        stands = layer.isValid() and layer.crs() == project.crs() and styled
        wrong += not stands
        kind = type(layer.renderer()).__name__ if styled else "no style"
        tell(f"{'ok   ' if stands else 'WRONG'} {layer.name()}: {layer.crs().authid()}, {kind}")
    tell(f"{len(layers)} layers, project in {crs}, {wrong} wrong")
    application.exitQgis()
    return 1 if wrong or not layers else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
