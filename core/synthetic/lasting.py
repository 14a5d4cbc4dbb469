"""Junctions of a synthetic place that stood in the archival epoch and still stand."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.synthetic.flight import make_flight
from core.synthetic.landscape import make_landscape
from core.synthetic.network import Network
from core.synthetic.options import SyntheticOptions
from core.synthetic.terrain import PlanPoints

LEAST_ARMS = 3


def options_of(folder: Path) -> SyntheticOptions:
    """The options a synthetic block was made with, as far as its landscape depends on them."""
    said = json.loads((folder / "truth" / "truth.json").read_text(encoding="utf-8"))["args"]
    plain = SyntheticOptions(
        said["size"],
        said["epoch"],
        said["relief_m"],
        said["seed"],
        strips=said.get("strips", 2),
        photos_per_strip=said.get("photos_per_strip", 3),
    )
    usual = abs(plain.road_change - said["road_change"]) < 1e-9
    return plain if usual else replace(plain, change=float(said["road_change"]))


def lasting_junctions(folder: Path) -> PlanPoints:
    """Easting and northing of the junctions of which three arms or more are there in both epochs.

    Args:
        folder: Folder of a synthetic block; its landscape is made anew from its options.
    """
    options = options_of(folder)
    flight = make_flight(options)
    return lasting_nodes(make_landscape(options, flight.terrain, flight.bounds).network)


def lasting_nodes(network: Network) -> PlanPoints:
    """Nodes with three arms or more that exist in both epochs."""
    arms = np.zeros(len(network.nodes), dtype=np.int64)
    for road in network.roads:
        if road.exists_now and road.existed_then:
            arms[[road.start, road.end]] += 1
    return network.nodes[arms >= LEAST_ARMS]
