"""AROSICS on one pair of rasters: one run of its tie point grid, told as JSON.

`PYTHON arosics_peer.py REFERENCE TARGET GRID_PX WINDOW_PX SHIFT_PX WORKERS` runs in an interpreter
of its own, in which AROSICS and GDAL are installed: nothing of this project is imported here.
"""

import json
import resource
import sys
from importlib import import_module
from time import perf_counter
from typing import Any


def main() -> None:
    """Match, and print the figures."""
    reference, target = sys.argv[1:3]
    grid, window, shift, workers = (int(word) for word in sys.argv[3:])
    made: Any = import_module("arosics").COREG_LOCAL
    arrays: Any = import_module("geoarray").GeoArray
    started, spent = perf_counter(), seconds_of_cpu()
    local = made(
        arrays(reference),
        arrays(target),
        grid_res=grid,
        window_size=(window, window),
        max_shift=shift,
        # Shifts are to be measured, not resampled away; every pixel of both is known.
        align_grids=False,
        calc_corners=False,
        CPUs=workers,
        progress=False,
        q=True,
    )
    table = local.CoRegPoints_table
    figures = {
        "wall": perf_counter() - started,
        "cpu": seconds_of_cpu() - spent,
        "points": table[["X_MAP", "Y_MAP", "X_SHIFT_M", "Y_SHIFT_M"]].to_numpy(float).tolist(),
        "outlier": [bool(flag) for flag in table["OUTLIER"].fillna(True)],
    }
    sys.stdout.write("\n" + json.dumps(figures) + "\n")


def seconds_of_cpu() -> float:
    """CPU of this process and of those it waited for, seconds."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(used.ru_utime + used.ru_stime for used in both)


if __name__ == "__main__":
    main()
