"""A photo of the mosaic some metres off: is it the worst place of the misfit map?

Takes blocks that were run. In each the mosaic is compared as it is, and again with the part of each
photo displaced by three metres, east and then north-west. Printed: displaced parts that are the
first place, that are significant at all, and significant places that nothing was done to. Ends with
1 when fewer than half are found or more than one in ten comparisons has a false one.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from app.project import described, read_project
from core.adjustment.influence import influence_of
from core.control.prediction import covariances_of
from core.matching.reference import level_of, open_heights
from core.mosaic.misfit import BlockErrors, measure_misfit
from core.mosaic.misfit_places import MisfitPlace, judge_misfit
from sessions.session import Session
from tests.core.mosaic.displaced import displaced

AWAY_M = ((3.0, 0.0), (-2.0, 2.0))


def significant(places: tuple[MisfitPlace, ...]) -> list[str]:
    """Photos of the places that are off."""
    return [place.photo_id for place in places if place.significant]


def spoil(folder: Path) -> tuple[int, int, int, int, int]:
    """Cases, first, found, comparisons with a false place, and false ones of the sound block."""
    given = described(read_project(folder))
    with Session.open(folder, "benchmark") as session:
        report = session.products.latest_value("adjustment")
        product = session.products.latest_value("mosaic")
    files, mosaic, seams = given.reference, folder / "results/mosaic.tif", product.seams
    gsd = product.grid.ground_sample_distance_m
    influence = influence_of(report, given.adjustment)
    assert influence is not None
    errors = BlockErrors(
        report,
        covariances_of(influence),
        open_heights(files, level_of(report.block)),
        files.ortho_sigma_m,
        files.dem_sigma_m,
    )
    sound = significant(judge_misfit(measure_misfit(mosaic, files.ortho, seams, errors)).places)
    cases = first = found = false = 0
    with tempfile.TemporaryDirectory() as scratch:
        spoilt = Path(scratch) / "mosaic.tif"
        for seam in seams:
            for away in AWAY_M:
                east, north = (round(metres / gsd) for metres in away)
                displaced(mosaic, spoilt, seam, (east, north))
                places = judge_misfit(measure_misfit(spoilt, files.ortho, seams, errors)).places
                names = significant(places)
                cases += 1
                first += names[:1] == [seam.photo_id]
                found += seam.photo_id in names
                false += any(name != seam.photo_id for name in names)
    return cases, first, found, false, len(sound)


def main() -> int:
    """Spoil every block that is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("blocks", nargs="+", type=Path)
    rows = {folder: spoil(folder) for folder in parser.parse_args().blocks}
    sys.stdout.write(
        "| block | displaced | first place | significant | with a false place | sound block |\n"
        "|---|---|---|---|---|---|\n"
    )
    for folder, row in rows.items():
        sys.stdout.write(f"| {folder.name} | {' | '.join(map(str, row))} |\n")
    cases, _, found, false, _ = np.sum(list(rows.values()), axis=0)
    return 0 if found >= cases / 2 and false <= cases / 10 else 1


if __name__ == "__main__":
    sys.exit(main())
