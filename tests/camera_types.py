"""The table of camera types, aggregated from certificates: `core/georeference/camera_types.csv`.

Run: python -m tests.camera_types [--data FOLDER]

`combined_reports.csv` of the folder of real data holds 1,933 calibration certificates. Written are
facts about types alone: of each make, model and lens the years, how many certificates, principal
distance and distance between opposite marks, each as median and robust standard deviation. Of a
type with fewer than five certificates nothing is told, and nothing of a single camera.
"""

import argparse
import csv
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from core.geometry.robust import robust_sigma
from core.georeference.principal_distance import FILE, HEAD

LEAST = 5
"""Certificates of a type of which something is told."""
APART = 0.05
"""Lenses of one type whose principal distances differ by more than this share are not alike."""
ANY = "any"
"""Make under which all certificates together stand."""


def groups(distances: Sequence[float]) -> list[list[int]]:
    """Rows by kind of lens: the sorted distances cut where they leap."""
    order = np.argsort(distances)
    leaps = np.diff(np.log(np.asarray(distances)[order])) > np.log1p(APART)
    return [part.tolist() for part in np.split(order, np.flatnonzero(leaps) + 1)]


def spread(values: Sequence[float]) -> tuple[float, float]:
    """Median, and standard deviation by the median of deviations."""
    middle = float(np.median(values))
    return middle, robust_sigma(np.asarray(values) - middle)


def told(make: str, model: str, rows: Sequence[dict[str, str]]) -> list[list[str]]:
    """Lines of one type, the most frequent lens first."""
    lines: list[tuple[int, list[str]]] = []
    for part in groups([float(row["focal"]) for row in rows]):
        own = [rows[number] for number in part]
        if len(own) < LEAST:
            continue
        years = sorted(row["date"][:4] for row in own if row["date"][:4].isdigit())
        sides = [float(row[key]) for row in own for key in ("lr_dist", "tb_dist") if row[key]]
        distance, side = spread([float(row["focal"]) for row in own]), spread(sides or [np.nan])
        figures = [*distance, *(side if len(sides) >= LEAST else ())]
        lens = Counter(row["lens_model"] for row in own).most_common(1)[0][0]
        cells = [make, model, lens, years[0], years[-1], str(len(own))]
        cells += [f"{figure:.2f}" for figure in figures] + [""] * (4 - len(figures))
        lines.append((len(own), cells))
    return [cells for _, cells in sorted(lines, key=lambda line: -line[0])]


def main() -> None:
    """Write the table anew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    given = parser.parse_args()
    source = given.data / "camera-families" / "combined_reports.csv"
    rows = [row for row in csv.DictReader(source.open(encoding="utf-8")) if row["focal"]]
    types: dict[tuple[str, str], list[dict[str, str]]] = defaultdict(list)
    for row in rows:
        types[row["camera_make"], row["camera_model"]].append(row)
    lines = told(ANY, "", rows)
    for (make, model), own in sorted(types.items()):
        lines += told(make, model, own) if make and model else []
    with FILE.open("w", encoding="utf-8", newline="") as target:
        writer = csv.writer(target, lineterminator="\n")
        writer.writerows([HEAD, *lines])
    sys.stdout.write(f"{len(lines)} types in {FILE}\n")


if __name__ == "__main__":
    main()
