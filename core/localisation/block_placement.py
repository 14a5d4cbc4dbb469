"""Coarse placement: a block, or one photo as a block of one, found on the reference as one body.

The scans are projected to the ground with their given orientations, then rotated, scaled and
shifted over the reference as a whole; doubled gradient angles are compared by FFT (METHODS 3).
The result is several hypotheses; only the resection after it can tell which is right, if any.

A single photo over woods and rebuilt villages has little evidence, and a poor georeference leaves
a large search space. Tied together, the photos leave four unknowns (rotation, scale, shift), and
all their ground contributes.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import cv2
import numpy as np

from core.arrays import Matrix, PixelPoints, PlanPosition, Scalars
from core.block import Photo, footprint
from core.doubts import Failure
from core.frames import opencv_from_pixel
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.resection import PhotoModel
from core.localisation.free_block import TURN_STEP, FreeBlock
from core.matching.global_search import (
    Backdrop,
    Laid,
    Level,
    Turn,
    angle_field,
    apart,
    distinct,
    square_about,
    steps_of,
)
from core.matching.patches import OpenPhoto, filled
from core.matching.reference import Reference
from core.raster.grid import Grid
from core.raster.scan_file import ScanFile, read_window


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A placed photo, and how far it can be trusted."""

    exterior: ExteriorOrientation
    """Exterior orientation after the placement."""
    covariance: Matrix
    """6 x 6 of X, Y, Z (m), omega, phi, kappa (rad)."""
    turn: Turn
    """What was done to the orientation the photo came with."""


@dataclass(frozen=True, slots=True)
class PlacementOptions:
    """How far and how finely to look."""

    # design: a pixel is ten metres of a usual photo: fields and roads show.
    photo_px: int = 200
    """Width of a photo in pixels in the first search, where the block is small enough."""
    # design: time; the work grows with its square.
    block_px: int = 420
    """Largest side of the block in pixels in the first search."""
    # design: time; half a minute of one core.
    most_work: float = 4e8
    """Trials times pixels of each; where it would be more, the first search is coarser."""
    # design: time; each costs a finer search.
    candidates: int = 24
    """Places of a coarser first search that are sought again more finely; of one that is not
    coarser, only those that are handed on."""
    # design: twice the first search, which finds its peak to half a pixel.
    fine_px: int = 900
    """Largest side of the block in pixels when the best places are sought again."""
    # design: of normal errors one in eighty lies outside.
    search_sigmas: float = 2.5
    """Half-width of the search in standard deviations of the prior."""
    # design: two of three sources are no further off.
    near_sigmas: float = 1.0
    """Half-width of a second search, where the first had to be coarser than `photo_px` says."""
    # design: time; half of what the wide search hands on.
    near_candidates: int = 12
    """Places of that second search that are sought again more finely."""
    # design: a peak is sought anew within one pixel of the coarser search.
    most_finer: float = 2.5
    """The best places are sought again at a pixel so many times smaller at most."""
    most_turn: float = np.pi
    """Largest turn of a photo by itself that is tried, radians."""
    # design: flying heights of an archive that are off by more are not known at all.
    most_scale: float = 0.2
    """Largest change of scale that is tried, 1 = 100 %."""
    # design: time; each costs a resection of every photo.
    hypotheses: int = 3
    """Placements that are handed on."""
    # design: time, spent only where all else has failed.
    in_reserve: int = 9
    """Placements of a block behind these, for when no photo stands at the likeliest."""
    # design: relief of a tenth of the flying height at a tenth of it beside the nadir.
    relief_share: float = 0.01
    """What the third dimension leaves of the placement, as a share of the flying height."""


# design: a photo by itself has no seams and no relief between photos: what its tilt leaves is in
# the covariance of its corners. Trials times pixels of 2e9 take some ten seconds.
WIDE = PlacementOptions(
    photo_px=140, block_px=600, fine_px=600, most_finer=3.0,
    most_work=2e9, most_scale=0.3, relief_share=0.0,
)  # fmt: skip
"""For one photo of unknown turn and scale."""
# design: as WIDE; a world file is good to three degrees and three per cent.
NARROW = PlacementOptions(
    photo_px=300, block_px=600, most_work=2e9,
    most_turn=float(np.radians(3.0)), most_scale=0.03, relief_share=0.0,
)  # fmt: skip
"""Finer, for one photo that came with nearly the right turn and scale."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBlock:
    """Where photos may lie that ties hold together, likeliest first."""

    photo_ids: tuple[str, ...]
    """The photos."""
    turns: tuple[Turn, ...]
    """What was done to the free block, likeliest first."""
    placements: Mapping[str, tuple[Placement, ...]]
    """By photo, one placement a turn."""


def place_block(
    free: FreeBlock,
    scans: Mapping[str, ScanFile],
    reference: Reference,
    options: PlacementOptions,
    mapper: Callable[..., Iterable[Any]] = map,
) -> PlacedBlock | Failure:
    """The most likely placements of a free block on the reference.

    Args:
        free: Photos in each other's right place.
        scans: Scans by photo.
        reference: Ortho and heights.
        options: Limits.
        mapper: Runs a function over photos or trials, such as the `map` of a thread pool.
    """
    block = free.block
    photos = {
        name: OpenPhoto(photo, block.cameras[photo.camera], scans[name])
        for name, photo in block.photos.items()
    }
    more = replace(options, hypotheses=options.hypotheses + options.in_reserve)
    return _place(photos, free.turns, free.turn_sigmas, reference, options=more, mapper=mapper)


def place_photo(
    opened: OpenPhoto,
    reference: Reference,
    options: PlacementOptions,
    mapper: Callable[..., Iterable[Any]] = map,
) -> tuple[Placement, ...]:
    """The most likely placements of one photo on the reference, likeliest first.

    Args:
        opened: The photo; its `approximate` orientation and `prior` bound the search.
        reference: Ortho and heights.
        options: Limits.
        mapper: Runs a function over trials, such as the `map` of a thread pool.
    """
    name, sigma = opened.photo.photo_id, float(opened.photo.prior.sigma_angles[2])
    most = min(options.search_sigmas * sigma, options.most_turn)
    turns = steps_of(most, TURN_STEP).astype(np.float64)
    placed = _place(
        {name: opened}, turns, np.abs(turns) / sigma, reference, options=options, mapper=mapper
    )
    return () if isinstance(placed, Failure) else placed.placements[name]


def _place(
    photos: Mapping[str, OpenPhoto],
    turns: Scalars,
    turn_sigmas: Scalars,
    reference: Reference,
    *,
    options: PlacementOptions,
    mapper: Callable[..., Iterable[Any]],
) -> PlacedBlock | Failure:
    """The most likely placements of photos as one body, under turns that their sources allow."""
    about = np.mean([opened.photo.exterior.centre[:2] for opened in photos.values()], axis=0)
    view = _View(photos, reference, about, block_reach_m(photos, about), mapper)
    finest = view.finest_gsd_m(options)
    own = [opened.photo for opened in photos.values()]

    def room_of(sigmas: float) -> _Room:
        return _Room.of(own, turns[turn_sigmas <= sigmas], sigmas, options)

    room = room_of(options.search_sigmas)
    gsd = room.first_gsd_m(finest, view.reach_m, options)
    finer = max(1, round(min(gsd * options.fine_px / (2 * view.reach_m), options.most_finer)))
    laid = view.laid(gsd)
    backdrop = view.backdrop(laid.half_m + room.shift_m, gsd / finer)
    count = options.candidates if gsd > finest else options.hypotheses
    best = view.sought(laid, backdrop.coarser(finer), room, count)
    if gsd > finest:
        best += view.sought_near(room_of(options.near_sigmas), gsd, best, options)
    if not best:
        return Failure("the reference ortho shows nothing where the block may lie")
    fine = view.laid(gsd / finer)
    # design: three halves of a pixel at the rim: the step of the coarse search is two.
    step = 1.5 * gsd / view.reach_m
    found = list(mapper(lambda turn: refined_turn(fine, backdrop, turn, step), best))
    found.sort(key=lambda turn: -turn.score)
    likeliest = apart(found, options.hypotheses, view.reach_m)
    return _placed(photos, about, tuple(likeliest), gsd / finer, options)


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """The block's photos and the reference they are sought on."""

    photos: Mapping[str, OpenPhoto]
    reference: Reference
    about: PlanPosition
    reach_m: float
    mapper: Callable[..., Iterable[Any]]

    def finest_gsd_m(self, options: PlacementOptions) -> float:
        """Ground sample distance of a first search that may take as long as it wants."""
        width = min(opened.width_m for opened in self.photos.values())
        return max(width / options.photo_px, 2 * self.reach_m / options.block_px)

    def laid(self, gsd_m: float) -> Laid:
        """The block on the ground."""
        return laid_block(self.photos, self.reference, self.about, self.reach_m, gsd_m, self.mapper)

    def backdrop(self, half_m: float, gsd_m: float) -> Backdrop:
        """The reference about the block."""
        return Backdrop.read(self.reference.ortho, self.about, half_m, gsd_m)

    def sought(
        self,
        laid: Laid,
        backdrop: Backdrop,
        room: "_Room",
        count: int,
        beside: Sequence[Turn] = (),
    ) -> list[Turn]:
        """The best places within a room, none of them one that is known already."""
        level = Level(laid, backdrop, Turn(0.0, 1.0), room.shift_m)
        trials = room.trials(self.reach_m / laid.grid.ground_sample_distance_m)
        return distinct(level.search(trials, 2, self.mapper), count, self.reach_m, beside)

    def sought_near(
        self, near: "_Room", gsd_m: float, known: Sequence[Turn], options: PlacementOptions
    ) -> list[Turn]:
        """The best places about where the sources put the block, as finely as its room allows.

        Over wide room a coarse search finds by chance what is as like as the true place. That lies
        close to what the sources say more often than not, and there is time for more detail there.
        """
        own = near.first_gsd_m(self.finest_gsd_m(options), self.reach_m, options)
        if own >= gsd_m:
            return []
        laid = self.laid(own)
        backdrop = self.backdrop(laid.half_m + near.shift_m, own)
        return self.sought(laid, backdrop, near, options.near_candidates, known)


def refined_turn(laid: Laid, backdrop: Backdrop, turn: Turn, step: float) -> Turn:
    """The same placement sought again at a finer scale, uphill from a first one."""
    # design: what a coarse pixel or two may hide, in fine pixels.
    level = Level(laid, backdrop, turn, 12 * laid.grid.ground_sample_distance_m)
    best: Turn | None = None
    tried: set[tuple[int, int]] = set()
    for width in (step, step, step / 2):
        begin = best or turn
        around = product((-width, 0.0, width), (-width, 0.0, width))
        trials = [(begin.kappa + kappa, begin.scale * (1 + scale)) for kappa, scale in around]
        # What was tried about another middle is no better than the best of it.
        places = [
            (round(2 * (kappa - turn.kappa) / step), round(2 * np.log(scale / turn.scale) / step))
            for kappa, scale in trials
        ]
        new = [trial for trial, place in zip(trials, places, strict=True) if place not in tried]
        tried |= set(places)
        found = level.search(new)
        best = max([*([best] if best else []), *found], key=lambda peak: peak.score, default=None)
    return best or turn


def block_reach_m(photos: Mapping[str, OpenPhoto], about: PlanPosition) -> float:
    """How far from the middle the photos reach, metres."""
    corners = [
        corner
        for opened in photos.values()
        for corner in footprint(opened.photo, opened.camera).exterior.coords
    ]
    return float(np.max(np.hypot(*(np.array(corners)[:, :2] - about).T)))


@dataclass(frozen=True, slots=True, eq=False)
class _Room:
    """What the sources leave open."""

    turns: Scalars
    shift_m: float
    scale: float

    @staticmethod
    def of(
        photos: Sequence[Photo], turns: Scalars, sigmas: float, options: PlacementOptions
    ) -> "_Room":
        """The room of the surest photo alone: sources of one archive may all err the same way."""
        above = np.array([p.approximate.centre[2] - p.ground_height_m for p in photos])
        tilt = above * [float(np.max(p.prior.sigma_angles[:2])) for p in photos]
        plan = np.hypot([float(np.max(p.prior.sigma_centre_m[:2])) for p in photos], tilt)
        height = np.array([p.prior.sigma_centre_m[2] for p in photos]) / above
        scale = min(sigmas * float(np.min(height)), options.most_scale)
        return _Room(turns, sigmas * float(np.min(plan)), scale)

    def first_gsd_m(self, gsd: float, reach_m: float, options: PlacementOptions) -> float:
        """A ground sample distance, or the finest above it at which the search is not too long."""
        while self._work(reach_m / gsd, self.shift_m / gsd) > options.most_work:
            # design: time; a third less work a step.
            gsd *= 1.15
        return gsd

    def _work(self, reach_px: float, shift_px: float) -> float:
        """Trials times pixels of each."""
        return len(self.trials(reach_px)) * (2 * (reach_px + shift_px)) ** 2

    def trials(self, reach_px: float) -> list[tuple[float, float]]:
        """Turns and scales in steps that move the block's rim by about two pixels."""
        step = 2.0 / reach_px
        turns = np.unique(np.round(self._open_turns() / step).astype(int)) * step
        kappas = [float(turn) for turn in turns if -np.pi <= turn < np.pi]
        scales = [float(1 + change) for change in steps_of(self.scale, step)]
        return list(product(kappas, scales))

    def _open_turns(self) -> Scalars:
        """The open turns with all between neighbours, so that any step finds some."""
        # design: turns are weighed in steps of a degree; quarters of that fill the gaps.
        half = np.radians(np.linspace(-0.5, 0.5, 5))
        return np.ravel(np.angle(np.exp(1j * (self.turns[:, None] + half[None, :]))))


def laid_block(
    photos: Mapping[str, OpenPhoto],
    reference: Reference,
    about: PlanPosition,
    reach_m: float,
    gsd_m: float,
    mapper: Callable[..., Iterable[Any]] = map,
) -> Laid:
    """All photos on one grid; every place shows the photo whose nadir is nearest."""
    whole = square_about(about, reach_m, gsd_m)
    side = whole.columns
    field = np.zeros((side, side), np.complex64)
    nearest = np.full((side, side), np.inf, np.float32)
    names = sorted(photos)

    def laid(name: str) -> tuple[Laid, tuple[slice, slice]]:
        window = _window_of(photos[name], whole)
        return laid_on_ground(photos[name], reference, _cut(whole, window)), window

    for name, (own, window) in zip(names, mapper(laid, names), strict=True):
        east, northing = own.grid.centres()
        nadir = photos[name].photo.exterior.centre
        away = np.hypot(east[None, :] - nadir[0], northing[:, None] - nadir[1])
        away = np.where(own.mask, away, np.inf).astype(np.float32)
        closer = away < nearest[window]
        field[window] = np.where(closer, own.field, field[window])
        nearest[window] = np.where(closer, away, nearest[window])
    return Laid(whole, field, np.isfinite(nearest))


def _window_of(opened: OpenPhoto, whole: Grid) -> tuple[slice, slice]:
    """Rows and columns of a grid that a photo can reach."""
    corners = np.array(footprint(opened.photo, opened.camera).exterior.coords)[:, :2]
    # design: relief and tilt move the outline by less.
    margin = 0.1 * opened.width_m
    place = whole.grid_from_object(
        np.array([corners.min(axis=0) - margin, corners.max(axis=0) + margin])
    )
    low = np.clip(np.floor(place.min(axis=0)).astype(int), 0, whole.columns - 1)
    high = np.clip(np.ceil(place.max(axis=0)).astype(int), low + 1, whole.columns)
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _cut(whole: Grid, window: tuple[slice, slice]) -> Grid:
    """A window of a grid as a grid."""
    rows, columns = window
    gsd = whole.ground_sample_distance_m
    return Grid(
        whole.west + columns.start * gsd,
        whole.north - rows.start * gsd,
        gsd,
        columns.stop - columns.start,
        rows.stop - rows.start,
    )


def _placed(
    photos: Mapping[str, OpenPhoto],
    about: PlanPosition,
    turns: tuple[Turn, ...],
    gsd_m: float,
    options: PlacementOptions,
) -> PlacedBlock:
    """All photos under every turn."""
    ground = float(np.mean([opened.photo.ground_height_m for opened in photos.values()]))
    placements: dict[str, tuple[Placement, ...]] = {}
    for name, opened in photos.items():
        above = float(opened.photo.exterior.centre[2]) - opened.photo.ground_height_m
        sigma = float(np.hypot(2 * gsd_m, options.relief_share * above))
        exteriors = [turn.moved(opened.photo.exterior, about, ground) for turn in turns]
        placements[name] = tuple(
            Placement(exterior, placement_covariance(opened.at(exterior), sigma), turn)
            for exterior, turn in zip(exteriors, turns, strict=True)
        )
    return PlacedBlock(tuple(sorted(photos)), turns, placements)


def laid_on_ground(opened: OpenPhoto, reference: Reference, grid: Grid) -> Laid:
    """The scan's doubled angles, rectified on a ground grid with the orientation it has."""
    photo, camera = opened.photo, opened.camera
    east, northing = np.meshgrid(*grid.centres())
    heights = reference.dem.on(grid).astype(np.float64).ravel()
    heights = np.where(np.isnan(heights), photo.ground_height_m, heights)
    ground = np.column_stack([east.ravel(), northing.ravel(), heights])
    pixels = photo.pixel_from_object(ground, camera)
    reduction = max(1, int(grid.ground_sample_distance_m / opened.ground_pixel_m))
    columns, rows = photo.size_px[0] // reduction, photo.size_px[1] // reduction
    grey = read_window(opened.scan, 0, 0, columns * reduction, rows * reduction, reduction)
    place = opencv_from_pixel(pixels / reduction).astype(np.float32).reshape(*east.shape, 2)
    across, down = place[:, :, 0], place[:, :, 1]
    image = cv2.remap(np.asarray(grey, np.float32), across, down, cv2.INTER_LINEAR)
    inside = inside_frame(photo, camera, pixels)
    if opened.scan.usable is not None:
        inside &= opened.scan.usable.at(pixels)
    mask = inside.reshape(east.shape)
    return Laid(grid, angle_field(filled(np.asarray(image, np.float32), mask), mask), mask)


def inside_frame(photo: Photo, camera: Camera, pixels: PixelPoints) -> np.ndarray:
    """True for scan pixels well inside the picture area (4 % of the frame stay away)."""
    # design: numerical safety; nowhere on any film.
    film = photo.interior.film_from_pixel(np.nan_to_num(pixels, nan=-1e9))
    # design: a margin that keeps marks and notes out.
    return np.all(np.abs(film) < 0.46 * np.array(camera.frame_mm), axis=1)


def placement_covariance(opened: OpenPhoto, sigma_m: float) -> Matrix:
    """Covariance of a placed photo: its middle is known to sigma, its corners to two sigma.

    The corners know less because the placement takes the photo as truly vertical.
    """
    photo, camera = opened.photo, opened.camera
    half = np.array(camera.frame_mm) / 2
    # design: the middle and the middles of the outer parts.
    film = np.array([[0.0, 0.0], [-0.6, -0.6], [0.6, -0.6], [0.6, 0.6], [-0.6, 0.6]]) * half
    pixels = photo.interior.pixel_from_film(film)
    ground = photo.object_from_pixel(pixels, np.full(5, photo.ground_height_m), camera)
    model = PhotoModel(photo.interior, camera, photo.atmosphere)
    derivatives = model.linearised(ground, photo.exterior)[1]
    sigma_px = sigma_m / opened.ground_pixel_m * np.array([1.0, 2.0, 2.0, 2.0, 2.0])
    weight = 1 / sigma_px**2
    information = np.einsum("nai,n,naj->ij", derivatives, weight, derivatives)
    return np.linalg.inv(information + np.linalg.inv(prior_covariance(photo)))


def prior_covariance(photo: Photo) -> Matrix:
    """6 x 6 covariance of the orientation the photo came with."""
    return np.diag(np.concatenate([photo.prior.sigma_centre_m, photo.prior.sigma_angles]) ** 2)
