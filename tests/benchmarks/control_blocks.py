"""Blocks of the control benchmark, run up to their ties, with what is true of them."""

import contextlib
import io
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from app.cli import main as gruber
from app.project import described, read_project
from core.block import Block
from core.localisation.initial_orientation import Site
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference, open_reference
from core.pipeline import made
from core.results import BlockInput, StageResults
from core.synthetic.archive import make_block
from core.synthetic.options import Size, SyntheticOptions
from core.synthetic.truth import Truth, read_truth
from sessions.session import Session

LEVELS = {"strong": 0.5, "ordinary": 0.33, "slight": 0.1}
"""Share of the road length that changed."""
NEAR_M = 3.0


@dataclass(frozen=True)
class Case:
    """One block, ready for any way to find control."""

    name: str
    level: str
    folder: Path
    given: BlockInput
    truth: Truth
    block: Block
    site: Site
    results: StageResults
    """Up to the ties of the first pass."""
    lasting: frozenset[str]
    """Junctions that stood then and stand now; of a real place, all."""

    @property
    def reference(self) -> Reference:
        return self.site.reference

    def opened(self, name: str, block: Block | None = None) -> OpenPhoto:
        photo = (block or self.block).photos[name]
        return OpenPhoto(photo, self.block.cameras[photo.camera], self.site.scans[name])


def plans(size: Size, first_seed: int) -> list[tuple[str, str, SyntheticOptions]]:
    """Twelve blocks: two epochs, three levels of change, flat and hilly."""
    found = []
    for number, (level, epoch, relief) in enumerate(product(LEVELS, (1938, 1984), (20.0, 200.0))):
        options = SyntheticOptions(size, epoch, relief, first_seed + number, change=LEVELS[level])
        name = f"{epoch} {level}, {'flat' if relief < 50 else 'hilly'}"
        found.append((name, level, options))
    return found


def strong_plans(
    size: Size, first_seed: int, count: int
) -> list[tuple[str, str, SyntheticOptions]]:
    """Blocks of 1938 of which half the roads and 95 per cent of the parcels are new."""
    return [
        (
            f"1938 strong, {'flat' if number % 2 == 0 else 'hilly'}",
            "strong",
            SyntheticOptions(
                size, 1938, (20.0, 200.0)[number % 2], first_seed + number, change=LEVELS["strong"]
            ),
        )
        for number in range(count)
    ]


def quietly(*words: str) -> int:
    """Run the program without its output."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return gruber(list(words))


def prepared(name: str, level: str, folder: Path, options: SyntheticOptions | None) -> Case:
    """Make a block where it is not there yet, and run it up to its ties."""
    if not (folder / "block.toml").is_file():
        assert options is not None
        make_block(folder, options)
    assert quietly("run", str(folder), "--until", "ties", "--workers", "1") == 0
    given = described(read_project(folder))
    with Session.open(folder, "prover") as session:
        stages = ("scans", "georeference", "reference", "localisation", "ties")
        results = StageResults(**{name: session.products.latest_value(name) for name in stages})
    features, photos = made(results.reference), made(results.georeference).block.photos
    block = Block(given.crs, given.cameras, photos, {}, {}, made(results.ties).ties)
    reference = open_reference(given.reference, block.search_bounds)
    site = Site(reference, results.opened_scans, features.points, features.sources)
    truth = read_truth(folder)
    lasting = {
        point_id
        for point_id, place in zip(features.points.ids, features.points.positions, strict=True)
        if features.sources[point_id] == "junction"
        and (
            truth.lasting_junctions is None
            or KDTree(truth.lasting_junctions).query(place[:2])[0] < NEAR_M
        )
    }
    return Case(name, level, folder, given, truth, block, site, results, frozenset(lasting))


def true_pixel(truth: Truth, photo_id: str, start: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Pixel at which a photo truly shows a place (1, 3), from one that is near."""
    heights = truth.heights_at(place)
    pixel = start.copy()
    for _ in range(3):
        off = truth.ground_of(photo_id, pixel, heights)[0] - place[0, :2]
        sides = [
            truth.ground_of(photo_id, pixel + step, heights)[0] - place[0, :2] - off
            for step in (np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]))
        ]
        pixel = pixel - np.linalg.solve(np.stack(sides, axis=1), off)
    return pixel[0]
