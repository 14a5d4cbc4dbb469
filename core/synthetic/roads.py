"""Writes the road layers as the map has them: by class, cut where attributes change."""

from pathlib import Path

import numpy as np
import shapely
from pyogrio.raw import write as write_vector
from shapely.geometry import LineString

from core.synthetic.network import Network, Road, swayed
from core.synthetic.options import seeded
from core.synthetic.orthos import CRS
from core.synthetic.terrain import PlanPoints

NODE_SIGMA_M, LINE_SIGMA_M = 0.35, 0.3
"""Deviation per axis of a mapped junction, and of the line between junctions, metres."""
LAYERS = {"main": "SilniceDalnice", "street": "Ulice", "track": "Cesta"}


def write_roads(folder: Path, network: Network, seed: int) -> None:
    """The present roads in three shapefiles.

    Through roads pass some junctions with roads of another layer uncut; other pieces are cut
    where only an attribute changes; some ends miss their junction by a few decimetres.

    Args:
        folder: Where to write them.
        network: Roads of both epochs.
        seed: Seed of the block.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = seeded(seed, "road layers")
    shifts = rng.normal(0.0, NODE_SIGMA_M, network.nodes.shape)
    lines: dict[str, list[tuple[PlanPoints, int]]] = {name: [] for name in LAYERS.values()}
    for road in network.roads:
        if road.exists_now:
            line = _mapped(road, shifts, rng)
            lines[LAYERS[road.kind]].append((line, road.route))
    for name, pieces in lines.items():
        if name == "SilniceDalnice":
            pieces = _joined(pieces, rng)
        _write_layer(folder / f"{name}.shp", name, _cut(pieces, rng))


def _mapped(road: Road, shifts: PlanPoints, rng: np.random.Generator) -> PlanPoints:
    """The line as digitised: displaced ends, slow deviation, few vertices."""
    share = np.linspace(0.0, 1.0, len(road.now))[:, None]
    line = road.now + (1 - share) * shifts[road.start] + share * shifts[road.end]
    line = swayed(line, LINE_SIGMA_M, rng)
    if rng.random() < 0.06:
        line[-1] += rng.uniform(-0.3, 0.3, 2)
    simple = shapely.simplify(LineString(line), 0.25)
    return shapely.get_coordinates(simple)


def _joined(
    pieces: list[tuple[PlanPoints, int]], rng: np.random.Generator
) -> list[tuple[PlanPoints, int]]:
    """Pieces of one route put together at half of the nodes they share."""
    result: list[tuple[PlanPoints, int]] = []
    for line, route in pieces:
        for number, (other, other_route) in enumerate(result):
            chain = _chained(other, line) if route == other_route else None
            if chain is not None and rng.random() < 0.5:
                result[number] = (chain, route)
                break
        else:
            result.append((line, route))
    return result


def _chained(one: PlanPoints, other: PlanPoints) -> PlanPoints | None:
    """Two lines as one where an end meets an end, else None."""
    for first in (one, one[::-1]):
        for second in (other, other[::-1]):
            if float(np.max(np.abs(first[-1] - second[0]))) < 1e-6:
                return np.vstack([first, second[1:]])
    return None


def _cut(
    pieces: list[tuple[PlanPoints, int]], rng: np.random.Generator
) -> list[tuple[PlanPoints, int]]:
    """A quarter of the pieces cut in two where an attribute changes."""
    result: list[tuple[PlanPoints, int]] = []
    for line, route in pieces:
        if len(line) > 4 and rng.random() < 0.25:
            at = int(rng.integers(1, len(line) - 1))
            result += [(line[: at + 1], route), (line[at:], route + 5000)]
        else:
            result.append((line, route))
    return result


def _write_layer(path: Path, name: str, pieces: list[tuple[PlanPoints, int]]) -> None:
    kinds = {
        "SilniceDalnice": ("TYP_SIL_K", ("S2", "S3")),
        "Ulice": ("TYP_UL_K", ("UL", "UL")),
        "Cesta": ("TYP_CES_K", ("C1", "C2")),
    }
    field, values = kinds[name]
    geometry = shapely.to_wkb(np.array([LineString(line) for line, _ in pieces], dtype=object))
    attributes = [
        np.arange(1, len(pieces) + 1, dtype=np.int32),
        np.array([values[(route // 5) % 2] for _, route in pieces], dtype=object),
    ]
    write_vector(
        path,
        geometry=geometry,
        field_data=attributes,
        fields=["FID_ZBG", field],
        geometry_type="LineString",
        crs=CRS,
        driver="ESRI Shapefile",
        encoding="CP1250",
    )
