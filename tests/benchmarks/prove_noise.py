"""Photos on the reference of another place: is any of them accepted?

Synthetic blocks of different seeds are different places. Every scan of a block is laid where a
photo of another block is, and goes through what a photo goes through once it is placed: all
reference points searched as far as the georeference may be off, resection, judgement. Then all
points are searched once more as control of a block that stood there. Ends with 1 when a photo is
accepted.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from core.control.proposals import judge_searches
from core.control.search import search_points
from core.control.stage import ControlStageOptions
from core.localisation.block_placement import Placement, prior_covariance
from core.localisation.photo_orientation import (
    OrientationOptions,
    OrientedPhoto,
    orient_placed_photo,
)
from core.matching.global_search import Turn
from core.matching.patches import OpenPhoto
from tests.benchmarks.control_blocks import Case, plans, prepared

NOWHERE = Turn(0.0, 1.0)
"""Photos stay where they are laid."""


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def laid_on(ground: Case, other: Case, turn: int) -> list[OpenPhoto]:
    """The scans of another place where the photos of this one are, each where another time."""
    camera = next(iter(ground.block.cameras.values()))
    names = sorted(other.site.scans)
    names = [*names[turn:], *names[:turn]]
    pairs = zip(ground.block.photos.values(), names, strict=False)
    return [OpenPhoto(photo, camera, other.site.scans[name]) for photo, name in pairs]


def accepted(ground: Case, opened: OpenPhoto, seed: int) -> bool:
    """Whether a photo that does not belong here is oriented here."""
    placed = [Placement(opened.photo.exterior, prior_covariance(opened.photo), NOWHERE)]
    found = orient_placed_photo(
        opened, ground.reference, ground.site.points, placed, OrientationOptions(),
        np.random.default_rng(seed),
    )  # fmt: skip
    return isinstance(found, OrientedPhoto)


def believed(ground: Case, photos: list[OpenPhoto]) -> tuple[int, int]:
    """Control of a whole wrong block: used, and measured."""
    options = ControlStageOptions()
    searches = [
        search
        for opened in photos
        for search in search_points(
            opened, ground.reference, ground.site.points, options.orientation
        )
    ]
    found, _ = judge_searches(searches, ground.site.sources)
    return sum(value.used for value in found), len(found)


def main() -> int:
    """Lay every block's photos on the others' places until there are enough."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=int, default=200)
    parser.add_argument("--seed", type=int, default=501)
    parser.add_argument("--blocks", type=int, default=4)
    parser.add_argument("--size", default="tiny", choices=("tiny", "small"))
    parser.add_argument("--no-control", action="store_true", help="orientation alone")
    parser.add_argument("--folder", type=Path, help="where blocks are kept")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    root = given.folder or Path(tempfile.mkdtemp(prefix="noise-"))
    cases = [
        prepared(name, level, root / f"p{options.seed}", options)
        for name, level, options in plans(given.size, given.seed)[: given.blocks]
    ]
    pairs = [(one, two) for one in cases for two in cases if one is not two]
    done = wrong = used = measured = 0
    for turn in range(len(cases[0].block.photos)):
        for ground, other in pairs:
            photos = laid_on(ground, other, turn)[: given.photos - done]
            if not photos:
                break
            wrong += sum(accepted(ground, opened, done + i) for i, opened in enumerate(photos))
            done += len(photos)
            found = (0, 0) if given.no_control else believed(ground, photos)
            used, measured = used + found[0], measured + found[1]
            say(f"{done} photos: {wrong} accepted; control {used} used of {measured} measured")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
