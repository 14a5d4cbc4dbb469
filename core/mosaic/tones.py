"""The tone of a balanced block: of each band, as one photo has it, or as the reference has it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from core.geometry.robust import nmad
from core.mosaic.overview import Overview
from core.mosaic.radiometry import STEPS, Balance, FilmPlane, balance_orthos
from core.raster.ortho import Ortho

WHITE = 255.0  # source: grays of the reference, as `Ortho.read` gives them
MOST_GAIN = 4.0  # design: more shows nothing but grain
"""A block is given the contrast of its reference up to this factor."""


def balance_bands(
    bands: Sequence[Sequence[Overview]],
    full_scale: float = 255.0,
    planes: Mapping[str, FilmPlane] | None = None,
) -> Mapping[str, Balance]:
    """The same of colours: each band of the orthos by itself.

    Args:
        bands: The orthos in small, all of the first band, all of the second, ...
        full_scale: As for `balance_orthos`.
        planes: As for `balance_orthos`.
    """
    first, *others = (balance_orthos(views, full_scale, planes) for views in bands)
    return {
        name: replace(one, others=tuple(other[name] for other in others))
        for name, one in first.items()
    }


def toned_as_photo(balances: Mapping[str, Balance], photo_id: str) -> Mapping[str, Balance]:
    """The same tones to each other, with the gain and offset of one photo left as they are."""
    own = balances[photo_id]
    by_band = [(1 / one.gain, -one.offset / one.gain) for one in (own, *own.others)]
    return {name: _toned(one, by_band) for name, one in balances.items()}


def toned_as_reference(
    balances: Mapping[str, Balance],
    bands: Sequence[Sequence[Overview]],
    reference: Ortho,
    full_scale: float,
) -> Mapping[str, Balance]:
    """The same tones to each other, with median and contrast of the reference where it shows.

    Args:
        balances: Of every photo.
        bands: The orthos in small, as for `balance_bands`; colours keep how they differ.
        reference: Grays of 0 to 255; what has changed since weighs little in the medians.
        full_scale: Largest gray value of the orthos.
    """
    own, there = list[np.ndarray](), list[np.ndarray]()
    for band, views in enumerate(bands):
        for view in views:
            patch = reference.read(view.grid)
            both = view.full & patch.mask
            balance = balances[view.photo_id].of_band(band)
            own.append(balance.corrected(view.values.copy(), view.grid)[both])
            there.append(patch.values[both] * (full_scale / WHITE))
    ours, theirs = np.concatenate(own).astype(np.float64), np.concatenate(there)
    spread = nmad(ours) if len(ours) else 0.0
    if spread <= 0:
        return balances
    gain = float(np.clip(nmad(theirs.astype(np.float64)) / spread, 1 / MOST_GAIN, MOST_GAIN))
    offset = float(np.median(theirs) - gain * np.median(ours))
    # In whole steps: one photo that moves a little does not change the tone of all.
    gain_step, offset_step = STEPS[0], STEPS[1] * full_scale
    whole = round(gain / gain_step) * gain_step, round(offset / offset_step) * offset_step
    return {name: _toned(one, [whole] * len(bands)) for name, one in balances.items()}


def _toned(balance: Balance, by_band: Sequence[tuple[float, float]]) -> Balance:
    """Every corrected gray times a gain, and an offset more, both by band."""
    (gain, offset), *others = by_band
    return replace(
        balance,
        gain=gain * balance.gain,
        offset=gain * balance.offset + offset,
        tilt=(gain * balance.tilt[0], gain * balance.tilt[1]),
        others=tuple(_toned(one, [own]) for one, own in zip(balance.others, others, strict=True)),
    )
