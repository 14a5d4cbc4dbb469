"""Several archival epochs over one place: each flown and filmed anew, with known changes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from core.synthetic.archive import write_block
from core.synthetic.changes import Change, make_changes, terrain_in
from core.synthetic.flight import Flight, make_flight
from core.synthetic.landscape import Landscape, make_landscape
from core.synthetic.network import Network, Road
from core.synthetic.options import PRESENT_YEAR, SyntheticOptions, seeded

FLIGHTS = 10_000
"""Seeds of flights, films and archives of one place lie so far from those of the next."""


@dataclass(frozen=True, slots=True, eq=False)
class FlownEpoch:
    """One of them."""

    year: int
    """When it was flown."""
    options: SyntheticOptions
    """Its flight, film and archive."""
    flight: Flight
    """The flight over the ground as it was, with what stood on it."""
    landscape: Landscape
    """The place as it was."""


def plan_epochs(options: SyntheticOptions, years: Sequence[int]) -> tuple[FlownEpoch, ...]:
    """The epochs of a place, nothing written.

    Roads and parcels change towards the present as `SyntheticOptions.epoch` has it; crops, light
    and grain of each epoch are its own.

    Args:
        options: Place and sizes; their own epoch is not looked at.
        years: Years of the epochs, in their order.
    """
    base = replace(options, epoch=years[0])
    of_years = [replace(options, epoch=year, seed=FLIGHTS * options.seed + year) for year in years]
    flights = [make_flight(one, options.seed) for one in of_years]
    areas = np.array([flight.bounds for flight in flights])
    (west, south), (east, north) = areas[:, :2].min(axis=0), areas[:, 2:].max(axis=0)
    bounds = (float(west), float(south), float(east), float(north))
    whole = make_landscape(base, flights[0].terrain, bounds)
    (west, south), (east, north) = areas[:, :2].max(axis=0), areas[:, 2:].min(axis=0)
    seen = (float(west), float(south), float(east), float(north))
    changes = make_changes(whole.network, seen, years, options.seed)
    today = terrain_in(whole.terrain, changes, PRESENT_YEAR, bare=True)
    epochs: list[FlownEpoch] = []
    for year, own, flight in zip(years, of_years, flights, strict=True):
        then = terrain_in(whole.terrain, changes, year)
        landscape = replace(
            whole,
            terrain=today,
            network=_network_in(whole.network, base, year),
            year=year,
            changes=changes,
            terrain_then=then,
        )
        epochs.append(
            FlownEpoch(year, own, replace(flight, terrain=then, bounds=bounds), landscape)
        )
    return tuple(epochs)


def make_epochs(
    folder: Path, options: SyntheticOptions, years: Sequence[int]
) -> tuple[FlownEpoch, ...]:
    """Write a block for each epoch into a folder named by its year.

    Args:
        folder: The folder above them.
        options: Place and sizes.
        years: Years of the epochs, in their order.
    """
    epochs = plan_epochs(options, years)
    present: Path | None = None
    for epoch in epochs:
        block = folder / str(epoch.year)
        write_block(block, epoch.flight, epoch.landscape, epoch.options, present=present)
        text = (block / "block.toml").read_text(encoding="utf-8")
        dated = text.replace("[scans]\n", f'[scans]\ntaken = "{epoch.year}"\n')
        (block / "block.toml").write_text(dated, encoding="utf-8")
        present = present or block
    return epochs


def changes_between(epochs: Sequence[FlownEpoch], first: int, last: int) -> tuple[Change, ...]:
    """The changes after one year, up to another."""
    return tuple(c for c in epochs[0].landscape.changes if first < c.year <= last)


def _network_in(network: Network, base: SyntheticOptions, year: int) -> Network:
    """The network of a year: of the roads that change, those that had changed by then."""
    left = replace(base, epoch=year).road_change / max(base.road_change, 1e-9)

    def then(road: Road) -> Road:
        changed = road.moved or road.exists_now != road.existed_then
        lot = seeded(base.seed, "changed", road.start, road.end).random()
        if not changed or lot <= left:
            return road
        return replace(road, then=road.now, existed_then=road.exists_now, moved=False)

    return replace(network, roads=tuple(then(road) for road in network.roads))
