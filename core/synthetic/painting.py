"""Paints a scene as it would look straight from above: one gray raster of the ground."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Int32, UInt8

from core.arrays import Scalars
from core.progress import Progress, Silent
from core.raster.grid import Grid
from core.synthetic.land_cover import PROFILE_LENGTH, PROFILE_STEP_M
from core.synthetic.landscape import Field, RoadLook, Scene
from core.synthetic.network import Road
from core.synthetic.random_surfaces import PlanPoints, smooth_step, white

Picture = UInt8[np.ndarray, "_ _"]
Window = tuple[int, int, int, int]
SHIFT = 8
"""Binary digits after the point in coordinates handed to OpenCV's drawing."""
TILE = 1536
MARGIN = 24
"""Pixels painted around a tile, so that blurs do not end at its edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A painted epoch."""

    grid: Grid
    """Where it lies."""
    gray: Picture
    """Brightness of the ground."""


def paint(scene: Scene, grid: Grid, progress: Progress | None = None) -> Ground:
    """The whole ground of one epoch.

    Args:
        scene: The land of the epoch, with slow fields that cover the grid.
        grid: Where to paint.
        progress: Told after every tile.

    Returns:
        The painted ground, the same however many threads painted it.
    """
    progress = progress or Silent()
    gray = np.empty((grid.rows, grid.columns), dtype=np.uint8)
    windows = [
        (column, row, min(TILE, grid.columns - column), min(TILE, grid.rows - row))
        for row in range(0, grid.rows, TILE)
        for column in range(0, grid.columns, TILE)
    ]
    brush = _Brush(scene, grid)
    with ThreadPoolExecutor(2) as pool:
        for done, (window, tile) in enumerate(
            zip(windows, pool.map(brush.tile, windows), strict=True)
        ):
            column, row, columns, rows = window
            gray[row : row + rows, column : column + columns] = tile
            progress.report(float(done + 1), float(len(windows)), "painting the ground")
    return Ground(grid, gray)


class _Brush:
    """What is looked up again and again while tiles of one scene are painted."""

    def __init__(self, scene: Scene, grid: Grid) -> None:
        self.scene = scene
        self.grid = grid
        tracts = scene.tracts
        self.outlines = [tract.outline for tract in tracts]
        self.boxes = _boxes(self.outlines)
        meadow = (118.0, 1.0, 1.5, 0.6, 0.8, 0.0)
        looks = [(t.tone, t.contrast, t.mottle, *t.across, t.offset_m) for t in tracts]
        self.looks = np.array([meadow, *looks], dtype=np.float32).T.copy()
        rows = [len(scene.profiles) - 1, *(t.profile for t in tracts)]
        self.profile = (np.array(rows) * PROFILE_LENGTH).astype(np.int32)
        self.road_boxes = _boxes([road.line(scene.past) for road, _ in scene.roads])
        self.house_boxes = _boxes([house.corners for house in scene.houses])

    def tile(self, window: Window) -> Picture:
        """One tile, with a margin that is cut off in the end."""
        column, row, columns, rows = window
        around = (column - MARGIN, row - MARGIN, columns + 2 * MARGIN, rows + 2 * MARGIN)
        part = self.grid.window(*around)
        fine = white(self.scene.seed, f"fine {self.scene.season}", *around)
        land = self._land(part)
        land = self._woods(land, part, fine)
        picture = np.clip(land, 0, 255).astype(np.uint8)
        self._bounds(picture, part)
        self._roads(picture, part, fine)
        self._objects(picture, part)
        gray = picture.astype(np.float32)
        soft = cv2.GaussianBlur(fine, (0, 0), 0.9)
        gray += 2.6 * fine + 9.0 * np.asarray(soft, dtype=np.float32)
        return np.clip(gray, 0, 255).astype(np.uint8)[MARGIN:-MARGIN, MARGIN:-MARGIN]

    def _land(self, part: Grid) -> Field:
        """Fields: tone of the tract, profile across its strips, mottle, light on the slope."""
        labels = self._labels(part)
        tone, contrast, mottle, east, north, offset = (look[labels] for look in self.looks)
        slow = self.scene.fields
        columns, rows = part.centres()
        away = east * (columns - self.grid.west).astype(np.float32)[None, :]
        away += north * (rows - self.grid.north).astype(np.float32)[:, None]
        away += offset
        away += smooth_step(slow.bend, slow.grid, part)
        place = (away * np.float32(1 / PROFILE_STEP_M)).astype(np.int32) & (PROFILE_LENGTH - 1)
        place += self.profile[labels]
        land = self.scene.profiles.reshape(-1)[place]
        land *= contrast
        land += tone
        land += mottle * smooth_step(slow.mottle, slow.grid, part)
        land *= smooth_step(slow.shade, slow.grid, part)
        return land

    def _labels(self, part: Grid) -> Int32[np.ndarray, "_ _"]:
        """Number of the tract each pixel lies in, 0 for none."""
        labels = np.zeros((part.rows, part.columns), dtype=np.int32)
        for number in _touching(self.boxes, part, 0.0):
            cv2.fillPoly(
                labels,
                [fixed_pixels(self.outlines[number], part)],
                int(number) + 1,
                cv2.LINE_8,
                SHIFT,
            )
        return labels

    def _woods(self, land: Field, part: Grid, fine: Field) -> Field:
        """Crowns lit from the sun's side where there is wood, and the shadow at its edge."""
        slow, gsd = self.scene.fields, part.ground_sample_distance_m
        wood = smooth_step(slow.wood, slow.grid, part)
        shadow = smooth_step(slow.wood_shadow, slow.grid, part)
        land *= 1.0 - 0.5 * shadow
        if float(wood.max()) < 0.02:
            return land
        crowns = _filtered(fine, 1.3 / gsd) - 0.8 * _filtered(fine, 2.9 / gsd)
        crowns /= max(float(crowns.std()), 1e-6)
        east, north = self.scene.sun.towards
        step = (round(1.6 * east / gsd), round(-1.6 * north / gsd))
        lit = crowns - np.roll(crowns, step[::-1], (0, 1))
        canopy = 62.0 + 8.0 * crowns - 15.0 * lit
        canopy += 0.9 * smooth_step(slow.mottle, slow.grid, part)
        sharp = np.clip((wood - 0.5 + 0.1 * crowns) * 3.0 + 0.5, 0.0, 1.0)
        return land + sharp * (canopy - land)

    def _bounds(self, picture: Picture, part: Grid) -> None:
        """Balks between tracts."""
        thick = max(1, round(0.9 / part.ground_sample_distance_m))
        for number in _touching(self.boxes, part, 2.0):
            tone = 96.0 if (int(number) * 7) % 5 else 138.0
            cv2.polylines(
                picture,
                [fixed_pixels(self.outlines[number], part)],
                True,
                (tone,),
                thick,
                cv2.LINE_AA,
                SHIFT,
            )

    def _roads(self, picture: Picture, part: Grid, fine: Field) -> None:
        """Verges, carriageways, and the wear that makes both uneven."""
        near = [self.scene.roads[k] for k in _touching(self.road_boxes, part, 12.0)]
        for road, look in near:
            extra = 3.2 if road.kind == "main" else 1.6
            self._line(picture, part, road.line(self.scene.past), look.width_m + extra, look.verge)
        for road, look in near:
            self._carriageway(picture, part, road, look)
        worn = np.zeros_like(picture)
        for road, look in near:
            self._line(worn, part, road.line(self.scene.past), look.width_m + 1.5, 255.0)
        if near:
            gsd = part.ground_sample_distance_m
            wear = _filtered(fine, 0.8 / gsd) + 2.2 * _filtered(fine, 4.0 / gsd)
            wear *= 8.0 / max(float(wear.std()), 1e-6)
            uneven = picture + wear * (worn / np.float32(255.0))
            np.copyto(picture, np.clip(uneven, 0, 255).astype(np.uint8))

    def _carriageway(self, picture: Picture, part: Grid, road: Road, look: RoadLook) -> None:
        line = road.line(self.scene.past)
        if look.ruts:
            for side in (-0.85, 0.85):
                self._line(picture, part, _beside(line, side), 1.0, look.tone)
        else:
            self._line(picture, part, line, look.width_m, look.tone)
        if road.kind == "main" and not self.scene.past:
            for side in (-0.45 * look.width_m, 0.45 * look.width_m):
                self._line(picture, part, _beside(line, side), 0.3, look.tone + 25.0)
        # Carriageways widen where roads meet.
        reach = np.full(2, (0.55 if look.ruts else 0.72) * look.width_m)
        _discs(picture, part, line[[0, -1]], reach, tones=np.full(2, look.tone))

    def _line(
        self, picture: Picture, part: Grid, line: PlanPoints, width_m: float, tone: float
    ) -> None:
        # OpenCV's smooth lines come out about one pixel wider than asked.
        thick = max(1, round(width_m / part.ground_sample_distance_m - 0.8))
        cv2.polylines(
            picture, [fixed_pixels(line, part)], False, (tone,), thick, cv2.LINE_AA, SHIFT
        )

    def _objects(self, picture: Picture, part: Grid) -> None:
        """Shadows first, then what throws them."""
        shadow = np.zeros_like(picture)
        houses = [self.scene.houses[k] for k in _touching(self.house_boxes, part, 15.0)]
        east, north = self.scene.sun.shadow
        for house in houses:
            fall = np.array([[east, north]]) * house.height_m * 0.8
            outline = np.vstack([house.corners, house.corners + fall])
            hull = cv2.convexHull(fixed_pixels(outline, part))
            cv2.fillConvexPoly(shadow, np.asarray(hull), (255.0,), cv2.LINE_AA, SHIFT)
        places, radii, tones = self._near_trees(part)
        thrown = places + np.array([[east, north]]) * radii[:, None] * 1.5
        _discs(shadow, part, thrown, radii, tones=np.full(len(radii), 255.0))
        dark = picture * (1.0 - 0.58 / 255.0 * shadow)
        np.copyto(picture, dark.astype(np.uint8))
        for house in houses:
            self._roof(picture, part, house.corners, house.tone)
        self._crowns(picture, part, places, radii, tones=tones)

    def _crowns(
        self, picture: Picture, part: Grid, places: PlanPoints, radii: Scalars, *, tones: Scalars
    ) -> None:
        """Every crown as a few lobes, those on the sunny side brighter."""
        light = np.array(self.scene.sun.towards)
        turns = (places @ np.array([7.0, 3.0]))[:, None] % 6.28 + np.array([0, 1.57, 3.14, 4.71])
        lobes = np.stack([np.cos(turns), np.sin(turns)], axis=2)
        around = places[:, None, :] + 0.45 * radii[:, None, None] * lobes
        all_places = np.concatenate([places[:, None, :], around], axis=1).reshape(-1, 2)
        all_radii = radii[:, None] * np.array([0.75, 0.55, 0.55, 0.55, 0.55])
        lit = 7.0 + 19.0 * (lobes @ light)
        all_tones = tones[:, None] + np.concatenate([np.zeros((len(radii), 1)), lit], axis=1)
        _discs(picture, part, all_places, all_radii.reshape(-1), tones=all_tones.reshape(-1))

    def _near_trees(self, part: Grid) -> tuple[PlanPoints, Scalars, Scalars]:
        trees = self.scene.trees
        west, south, east, north = part.bounds
        x, y = trees.places[:, 0], trees.places[:, 1]
        near = (x > west - 20) & (x < east + 20) & (y > south - 20) & (y < north + 20)
        return trees.places[near], trees.radii_m[near], trees.tones[near]

    def _roof(self, picture: Picture, part: Grid, corners: PlanPoints, tone: float) -> None:
        """Two slopes, the one towards the sun brighter."""
        one, two = (corners[0] + corners[3]) / 2, (corners[1] + corners[2]) / 2
        outward = corners[0] - corners[3]
        facing = float(outward @ np.array(self.scene.sun.towards) / np.linalg.norm(outward))
        for half, sign in (
            (np.vstack([corners[:2], two, one]), 1.0),
            (np.vstack([one, two, corners[2:]]), -1.0),
        ):
            value = float(np.clip(tone * (1.0 + 0.32 * sign * facing), 20, 250))
            cv2.fillConvexPoly(picture, fixed_pixels(half, part), (value,), cv2.LINE_AA, SHIFT)


def _discs(
    picture: Picture, part: Grid, places: PlanPoints, radii_m: Scalars, *, tones: Scalars
) -> None:
    """Filled circles, one after the other."""
    centres = fixed_pixels(places, part).tolist()
    radii = (radii_m / part.ground_sample_distance_m * (1 << SHIFT)).astype(int).tolist()
    for centre, radius, tone in zip(centres, radii, tones.tolist(), strict=True):
        cv2.circle(picture, centre, radius, (tone,), -1, cv2.LINE_AA, SHIFT)


def fixed_pixels(points: PlanPoints, part: Grid) -> Int32[np.ndarray, "_ 2"]:
    """Points of the ground as OpenCV's fixed-point pixels, counted from pixel centres."""
    pixels = part.grid_from_object(points) - 0.5
    return np.round(pixels * (1 << SHIFT)).astype(np.int32)


def _boxes(lines: list[PlanPoints]) -> Float32[np.ndarray, "_ 4"]:
    boxes = [np.concatenate([line.min(axis=0), line.max(axis=0)]) for line in lines]
    return np.array(boxes, dtype=np.float32).reshape(-1, 4)


def _touching(boxes: Float32[np.ndarray, "_ 4"], part: Grid, margin_m: float) -> list[int]:
    """Numbers of the boxes that touch a part of the ground."""
    west, south, east, north = part.bounds
    touch = (boxes[:, 0] < east + margin_m) & (boxes[:, 2] > west - margin_m)
    touch &= (boxes[:, 1] < north + margin_m) & (boxes[:, 3] > south - margin_m)
    return np.flatnonzero(touch).tolist()


def _beside(line: PlanPoints, left_m: float) -> PlanPoints:
    """The line moved to its left by a distance, metres."""
    forward = np.gradient(line, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    return line + left_m * np.column_stack([-forward[:, 1], forward[:, 0]])


def _filtered(field: Field, sigma_px: float) -> Field:
    return np.asarray(cv2.GaussianBlur(field, (0, 0), max(sigma_px, 0.4)), dtype=np.float32)
