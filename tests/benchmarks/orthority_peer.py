"""Orthority on one frame: the same ortho several times over, told as JSON.

`PYTHON orthority_peer.py TASK.json` runs in an interpreter of its own, in which Orthority is
installed: nothing of this project is imported here.
"""

import json
import resource
import sys
from importlib import import_module
from time import perf_counter
from typing import Any


def main() -> None:
    """Rectify, and print the best seconds of all rounds and the peak of memory."""
    with open(sys.argv[1], encoding="utf-8") as file:
        task = json.load(file)
    pinhole: Any = import_module("orthority.camera").PinholeCamera
    made: Any = import_module("orthority.ortho").Ortho
    walls, spent = [], []
    for _ in range(task["rounds"]):
        wall, cpu = perf_counter(), seconds_of_cpu()
        camera = pinhole(
            task["size_px"], task["focal_mm"], task["sensor_mm"], xyz=task["xyz"], opk=task["opk"]
        )
        ortho = made(task["scan"], task["dem"], camera, crs=task["crs"])
        ortho.process(
            task["ortho"],
            resolution=(task["gsd_m"], task["gsd_m"]),
            interp="cubic",
            dem_interp="bilinear",
            write_mask=False,
            build_ovw=False,
            creation_options={"compress": "deflate", "zlevel": 1, "predictor": 2, "tiled": True},
            overwrite=True,
            aligned_pixels=True,
        )
        walls.append(perf_counter() - wall)
        spent.append(seconds_of_cpu() - cpu)
    # source: Linux, ru_maxrss in KiB
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    figures = {"wall": min(walls), "cpu": min(spent), "peak_mib": peak}
    sys.stdout.write("\n" + json.dumps(figures) + "\n")


def seconds_of_cpu() -> float:
    """CPU of this process, seconds."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
