"""One place in two epochs: terrain, roads, parcels, woods, houses, trees, and the sun over them."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32

from core.raster.grid import Grid
from core.synthetic.changes import Change, halls_in, soil_in, with_woods
from core.synthetic.land_cover import (
    House,
    Tract,
    Trees,
    make_houses,
    make_profiles,
    make_tracts,
    make_trees,
)
from core.synthetic.network import Network, Road, make_network
from core.synthetic.options import PRESENT_YEAR, SyntheticOptions, seeded
from core.synthetic.random_surfaces import Bounds, Terrain, fractal, smooth_step

Field = Float32[np.ndarray, "_ _"]
COARSE = 4
"""Slow fields (shade, woods, mottle) are kept at every fourth pixel of the painted ground."""
HALO = 8
"""Coarse pixels around the painted ground, so that shadows may come from outside."""


@dataclass(frozen=True, slots=True)
class RoadLook:
    """How a road appears from above."""

    width_m: float
    """Width of the carriageway, metres."""
    tone: float
    """Gray of the carriageway."""
    ruts: bool
    """Two wheel tracks with grass between rather than a carriageway."""
    verge: float
    """Gray of the verge."""


@dataclass(frozen=True, slots=True)
class Sun:
    """Where the light comes from."""

    azimuth: float
    """From grid north, clockwise, radians."""
    elevation: float
    """Above the horizon, radians."""

    @property
    def towards(self) -> tuple[float, float]:
        """Horizontal unit vector towards the sun (east, north)."""
        return float(np.sin(self.azimuth)), float(np.cos(self.azimuth))

    @property
    def shadow(self) -> tuple[float, float]:
        """Shadow (east, north) of one metre of height, metres."""
        east, north = self.towards
        return -east / float(np.tan(self.elevation)), -north / float(np.tan(self.elevation))


@dataclass(frozen=True, slots=True, eq=False)
class SlowFields:
    """What changes slowly over the land, as coarse rasters around the painted ground."""

    grid: Grid
    """Grid of the coarse rasters, halo included."""
    mottle: Field
    """Irregular tone of soil and growth, gray values."""
    shade: Field
    """Light on the slope over light on level ground."""
    wood: Field
    """Share of wood, 0 to 1."""
    wood_shadow: Field
    """Share of shadow that woods cast, 0 to 1."""
    bend: Field
    """How far the strips bend sideways, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The land of one epoch, ready to be painted."""

    past: bool
    """The archival epoch, or the present."""
    seed: int
    """Seed of the block."""
    sun: Sun
    """The light."""
    tracts: list[Tract]
    """Parcels."""
    profiles: Float32[np.ndarray, "profiles steps"]
    """Gray across the strips of parcels."""
    roads: list[tuple[Road, RoadLook]]
    """Roads that exist, tracks first."""
    houses: list[House]
    """Buildings."""
    trees: Trees
    """Single trees."""
    fields: SlowFields
    """Mottle, shade, woods."""
    season: str = ""
    """What the finest texture goes with besides the epoch."""


@dataclass(frozen=True, slots=True, eq=False)
class Landscape:
    """The place itself; its epochs are scenes."""

    options: SyntheticOptions
    """What was asked for."""
    terrain: Terrain
    """The ground, the same in both epochs."""
    network: Network
    """Roads of both epochs and villages."""
    bounds: Bounds
    """Area the landscape covers, metres."""
    year: int | None = None
    """Which of several archival epochs it is; None where there is but one."""
    changes: tuple[Change, ...] = ()
    """What has changed between archival epochs."""
    terrain_then: Terrain | None = None
    """The ground of the archival epoch with what stands on it; None: as it is now."""

    def scene(self, past: bool, grid: Grid) -> Scene:
        """The land of one epoch over the grid that shall be painted."""
        seed, options = self.options.seed, self.options
        year = (self.year or options.epoch) if past else PRESENT_YEAR
        season = f"{past} {year}" if past and self.year is not None else None
        tracts = make_tracts(
            self.network,
            past,
            options.parcel_change,
            options.recency,
            seed=seed,
            season=season,
            still=None if season is None else replace(options, epoch=year).parcel_change,
        )
        tracts += soil_in(self.changes, year)
        then, now = make_houses(self.network, seed, options.recency)
        order = {"track": 0, "street": 1, "main": 2}
        roads = sorted(
            (road for road in self.network.roads if road.exists(past)), key=lambda r: order[r.kind]
        )
        sun = _sun(season or past, seed)
        return Scene(
            past,
            seed,
            sun,
            tracts,
            make_profiles(seed, grid.ground_sample_distance_m, season),
            [(road, road_look(road, past, seed)) for road in roads],
            [*(then if past else now), *halls_in(self.changes, year)],
            make_trees(self.network, tracts, grid.bounds, past, seed=seed),
            _slow_fields(self, past, grid, sun, (season or past, year)),
            season or str(past),
        )


def make_landscape(options: SyntheticOptions, terrain: Terrain, bounds: Bounds) -> Landscape:
    """The place of a block.

    Args:
        options: What is wanted.
        terrain: The ground, reaching beyond the bounds.
        bounds: Area that can be seen, metres; roads and parcels reach some way beyond it.

    Returns:
        The landscape of both epochs.
    """
    west, south, east, north = bounds
    wider = (west - 450.0, south - 450.0, east + 450.0, north + 450.0)
    network = make_network(wider, options.road_change, seeded(options.seed, "network"))
    return Landscape(options, terrain, network, wider)


def road_look(road: Road, past: bool, seed: int) -> RoadLook:
    """Width and tone of a road: bright dust then and dark asphalt now, but not always."""
    rng = seeded(seed, "look", road.route, past)
    dark = rng.random() < {"main": 0.15, "street": 0.2, "track": 0.12}[road.kind]
    if not past:
        dark = rng.random() < {"main": 0.5, "street": 0.45, "track": 0.2}[road.kind]
    verge = float(rng.uniform(92.0, 138.0))
    if road.kind == "track":
        tone = rng.uniform(72, 104) if dark else rng.uniform(165, 212)
        ruts = bool(rng.random() < 0.25)
        return RoadLook(float(rng.uniform(2.6, 3.8)), float(tone), ruts, verge)
    if past:
        tone = rng.uniform(78, 108) if dark else rng.uniform(172, 218)
        width = rng.uniform(4.3, 5.8) if road.kind == "main" else rng.uniform(3.8, 5.5)
    else:
        tone = rng.uniform(72, 112) if dark else rng.uniform(150, 190)
        width = rng.uniform(5.8, 7.4) if road.kind == "main" else rng.uniform(4.2, 6.0)
    return RoadLook(float(width), float(tone), False, verge)


def _sun(season: str | bool, seed: int) -> Sun:
    """Higher in the morning then than now."""
    past, rng = season is not False, seeded(seed, "sun", season)
    azimuth = rng.uniform(120.0, 165.0) if past else rng.uniform(150.0, 215.0)
    return Sun(float(np.radians(azimuth)), float(np.radians(rng.uniform(36.0, 56.0))))


def _slow_fields(
    landscape: Landscape, past: bool, grid: Grid, sun: Sun, season: tuple[str | bool, int]
) -> SlowFields:
    gsd = grid.ground_sample_distance_m * COARSE
    rows, columns = -(-grid.rows // COARSE) + 2 * HALO, -(-grid.columns // COARSE) + 2 * HALO
    coarse = Grid(grid.west - HALO * gsd, grid.north + HALO * gsd, gsd, columns, rows)
    seed, shape = landscape.options.seed, (rows, columns)
    epoch = fractal(shape, gsd, 2.0, 300.0, slope=0.18, rng=seeded(seed, "mottle", season[0]))
    soil = fractal(shape, gsd, 24.0, 500.0, slope=0.4, rng=seeded(seed, "soil"))
    then = landscape.terrain_then if past else None
    shade = _shade(then or landscape.terrain, coarse, sun)
    wood = with_woods(_wood(landscape, past, coarse), coarse, landscape.changes, season[1])
    reach = np.array(sun.shadow) * 13.0 / gsd
    shadow = np.roll(wood, (round(-reach[1]), round(reach[0])), (0, 1)) * (1 - wood)
    bend = 2.5 * fractal(shape, gsd, 120.0, 500.0, slope=0.6, rng=seeded(seed, "bend"))
    return SlowFields(coarse, 7.5 * epoch + 4.5 * soil, shade, wood, shadow, bend)


def _shade(terrain: Terrain, grid: Grid, sun: Sun) -> Field:
    """Light on the slopes, from every tenth metre of the terrain."""
    step = max(grid.ground_sample_distance_m, 10.0)
    wide = Grid.over(grid.bounds, step)
    heights = terrain.on(wide)
    down, right = np.gradient(heights, step)
    east, north = sun.towards
    light = 1.0 - (right * east - down * north) / np.tan(sun.elevation)
    return smooth_step(np.clip(light, 0.45, 1.6).astype(np.float32), wide, grid)


def _wood(landscape: Landscape, past: bool, grid: Grid) -> Field:
    """Woods: where a slow chance field, partly of the epoch, is high; never in a village."""
    options, gsd = landscape.options, grid.ground_sample_distance_m
    shape = (grid.rows, grid.columns)
    common = fractal(shape, gsd, 260.0, 1100.0, slope=0.9, rng=seeded(options.seed, "wood"))
    edge = fractal(shape, gsd, 6.0, 60.0, slope=0.5, rng=seeded(options.seed, "wood edge", past))
    other = fractal(shape, gsd, 180.0, 700.0, slope=0.9, rng=seeded(options.seed, "wood", past))
    share = 0.5 * options.road_change / 0.33 if past else 0.0
    woodness = common + share * other + 0.07 * edge
    wide = Grid.over(grid.bounds, max(gsd, 12.0))
    east, north = np.meshgrid(*wide.centres())
    away = landscape.network.village_distance(np.column_stack([east.ravel(), north.ravel()]))
    near = np.clip(1.0 - away / 160.0, 0.0, 1.5).reshape(east.shape).astype(np.float32)
    woodness -= (2.2 + 0.5 * edge) * smooth_step(near, wide, grid)
    limit = np.quantile(woodness[::16, ::16], 0.86 if past else 0.82)
    return np.clip((woodness - limit) * 60.0 / gsd + 0.5, 0.0, 1.0).astype(np.float32)
