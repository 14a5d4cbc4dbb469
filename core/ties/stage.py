"""Stage ties: the same place of the ground measured finely in several scans."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from core.block import Block, TiePoints
from core.doubts import Doubt
from core.geometry.exterior import ExteriorOrientation
from core.progress import Work
from core.ties.features import Features
from core.ties.tie_points import TieOptions, match_block_features

# design: what two photos have in common then changes by as much; features are the same.
REMATCH_SHARE = 0.02
"""Ties are matched again where a photo has moved by more than this share of its width."""


@dataclass(frozen=True, slots=True, eq=False)
class Tied:
    """The tie points of the block."""

    ties: TiePoints
    """All rays."""
    doubts: tuple[Doubt, ...]
    """Photos and pairs that tie badly."""
    matched_at: Mapping[str, ExteriorOrientation]
    """Where the photos lay when their ties were matched."""

    def still_hold(self, block: Block) -> bool:
        """Whether photos lie close enough to where they were matched for the same ties."""
        for name, photo in block.photos.items():
            then = self.matched_at.get(name)
            if then is None:
                return False
            away = np.hypot(*(photo.exterior.centre - then.centre)[:2])
            if away > REMATCH_SHARE * photo.width_m(block.camera_of(name)):
                return False
        return True


def tie_photos(
    block: Block, features: Mapping[str, Features], options: TieOptions, work: Work
) -> Tied:
    """Tie points between all photos that overlap where they were localised.

    Args:
        block: Photos where they lie.
        features: Their features, as localisation saw them.
        options: Settings.
        work: Progress, and the source of chance.
    """
    ties, _, doubts = match_block_features(
        block, features, options, work.progress, work.random("ties")
    )
    places = {name: photo.exterior for name, photo in block.photos.items()}
    return Tied(ties, doubts, places)
