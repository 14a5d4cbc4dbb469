"""The block in 3D as one browser sees it: frustums, drape, points by state, residual vectors."""

from dataclasses import dataclass

import numpy as np
import viser
from jaxtyping import UInt8
from viser import transforms

from core.arrays import Position
from ui.review import looks
from ui.review.looks import LOOKS, ShownState, rgb
from ui.review.scene import (
    EDGE_PARTS,
    FrustumPicture,
    Points,
    ScenePicture,
    Segments,
    area_lines,
    ellipse_lines,
    exaggerate_heights,
)
from ui.review.state import SceneOptions
from ui.review.tiles import Colour
from ui.views.flight import Pose, flight_between, pose_around, pose_inside
from ui.views.labels import LABELS, Labels, names_apart, plain_name
from ui.views.meshes import needles_glb

TERRAIN = "/terrain"
HILLSHADE = "/hillshade"
VEIL = "/veil"
FOOTPRINTS = "/footprints"
CHOSEN = "/chosen"
AREAS = "/areas"
ELLIPSES = "/ellipses"
OTHERS = "/others"
VECTORS = "/vectors"
CHECKS = "/checks"
TIES = "/ties"
TIE_VECTORS = "/tie_vectors"
CURRENT = "/current"
CURRENT_RAY = "/current_ray"
SPECIALS = "/specials"
"""Names of nodes of the scene, which tests look for as well."""
IMAGE_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])
"""Viser's cameras look along +z with y down; image space has y up and z towards the sky."""
NOWHERE = np.zeros((1, 3))
FIELD_OF_VIEW = float(np.radians(45))
POINT_SHARE = 0.0062
"""Size of a point as a share of the block's extent, when the whole block is in sight."""
FIT_SHARE = 1.9
"""Distance of the eye from the block, in extents, when the whole block is in sight."""
FROM_SOUTH = np.array([0.0, -0.5, 1.0])
"""Where the eye is at first, seen from the middle of the block."""
UP = np.array([0.0, 0.0, 1.0])
RING_PARTS = 28
TIE_PX, LABEL_PX = 4.0, 22.0
"""Size of a tie point on the screen, and of a letter, pixels."""
LIFT = 0.006
"""Points and lines float this share of the block's extent above the drape, to stay visible."""


def photo_node(photo_id: str) -> str:
    """Frustum of one photo."""
    return f"/photos/{plain_name(photo_id)}"


def points_node(state: ShownState) -> str:
    """Cloud of the control points in one state."""
    return f"/points/{state}"


def reach_pixel_m(reach_m: float) -> float:
    """Size of a pixel when the whole block is in sight, before the window is known, metres."""
    return reach_m / 700


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """What does not change while the desk is open."""

    extent_m: float
    """Longer side of the block on the ground, metres."""
    middle: Position
    """Middle of the block on the ground, local frame, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Pointed:
    """What is current, in the local frame."""

    position: Position
    """The surveyed point."""
    centre: Position
    """Perspective centre of the photo it is looked at in."""
    photo_id: str = ""
    """That photo."""


class BlockView:
    """The nodes of one browser's scene; built once, then only what changed is sent."""

    def __init__(self, client: viser.ClientHandle, stage: Stage, picture: ScenePicture) -> None:
        self._client = client
        self._scene = client.scene
        self._stage = stage
        self._lift = np.array([0.0, 0.0, LIFT * stage.extent_m])
        self._point_m = POINT_SHARE * stage.extent_m
        self._pixel_m = reach_pixel_m(stage.extent_m)
        self._sizes: dict[str, float] = {}
        self._pointed: Pointed | None = None
        self._frustums: dict[str, viser.CameraFrustumHandle] = {}
        self._clouds: dict[str, viser.PointCloudHandle] = {}
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self._names = Labels(client.scene, LABELS)
        self._letters = Labels(client.scene, SPECIALS)
        self._sheets: dict[str, viser.GlbHandle] = {}
        self._laid: dict[str, bytes] = {}
        self._sent: dict[str, object] = {}
        self._needles: viser.GlbHandle | None = None
        self._picture, self._options = picture, SceneOptions()
        self._outside: Pose | None = None
        self._whole: tuple[Position, float] | None = None
        self._flight: list[Pose] = []
        self._build(picture)
        self.fit(None)

    def show(self, picture: ScenePicture, options: SceneOptions, pointed: Pointed | None) -> None:
        """Bring the scene up to date with a picture and a seat's switches."""
        before, hidden = self._options, options.hidden
        self._picture, self._options = picture, options
        inside = self._frustum_of(options.inside)
        for name in self._sheets:
            self._show_sheet(name)
        for frustum in picture.frustums:
            shown = "photos" not in hidden and inside is None
            self._show_frustum(frustum, picture.depth_m, shown)
        self._show_points(picture, options)
        self._show_lines(FOOTPRINTS, picture.footprints, "footprints" not in hidden)
        self._show_chosen(picture, options.photo)
        self._show_areas(picture, options)
        self._show_vectors(picture, options)
        self._show_tie_vectors(picture, options)
        self._names.show(picture.labels, "labels" not in hidden and inside is None)
        self._show_current(pointed)
        self._show_specials()
        if options.light != before.light:
            for name in (CHOSEN, CURRENT_RAY, SPECIALS):
                colour = looks.CURRENT if name == CURRENT_RAY else looks.CHOSEN
                seen = rgb(looks.against(colour, options.light))
                self._lines[name].colors = np.array(seen, dtype=np.uint8)
        if options.inside != before.inside:
            self._fly(inside)

    def lay(self, name: str, sheet: bytes) -> None:
        """Lay a mesh, a GLB, over or under everything."""
        if self._laid.get(name) is not sheet:
            self._laid[name] = sheet
            self._sheets[name] = self._scene.add_glb(name, sheet, cast_shadow=False)
            self._sent.pop(f"{name} shown", None)
        self._show_sheet(name)

    def fly_on(self) -> bool:
        """The next step of the eye on its way; False once it is there."""
        if self._flight:
            self._look(self._flight.pop(0))
        return bool(self._flight)

    def picture(self, photo_id: str, thumbnail: Colour) -> None:
        """Put a photo's small picture, in the film frame, into its frustum."""
        if photo_id in self._frustums:
            self._frustums[photo_id].image = thumbnail

    def seen_from(self, distance_m: float, pixel_m: float) -> None:
        """Draw points and ring nearly as large on the screen from wherever they are seen.

        Args:
            distance_m: Distance of the eye from what it turns about.
            pixel_m: Size of a pixel of the screen there.
        """
        reach = self._stage.extent_m
        nearness = min(distance_m / (FIT_SHARE * reach), 2.0)
        self._point_m = POINT_SHARE * reach * nearness**0.7
        self._pixel_m = pixel_m
        for name, cloud in self._clouds.items():
            cloud.point_size = self._size_of(name)
        self._show_current(self._pointed)
        self._show_specials()
        inside, camera = self._frustum_of(self._options.inside), self._client.camera
        if inside is not None and not self._flight and self._is_at(inside.centre):
            # The window may have another shape than before.
            self._look(pose_inside(inside, self._picture.level_m, camera.aspect))
        else:
            self.fit_again()

    @property
    def is_outgrown(self) -> bool:
        """Whether the window has another shape than when the whole block was looked at."""
        return self._whole is not None and self._client.camera.aspect != self._whole[1]

    def fit_again(self) -> None:
        """Look at the whole block in a window of another shape, if nobody looks elsewhere."""
        if self.is_outgrown and self._whole and self._is_at(self._whole[0]):
            self.fit(None)

    def _is_at(self, place: Position) -> bool:
        """Whether the eye is there, to a pixel: a browser tells it in single precision."""
        at = self._client.camera.position
        return bool(np.allclose(at, place, rtol=0.0, atol=self._pixel_m))

    def fit(self, pointed: Pointed | None) -> None:
        """Look at the whole block from the south, or at what is current."""
        reach, camera = self._stage.extent_m, self._client.camera
        camera.max_orbit_distance = 30 * reach
        camera.near, camera.far = reach * 1e-3, reach * 40
        self._outside, self._flight = None, []
        if pointed is None:
            # All that lies on the ground, and the photos above it.
            grounds = self._picture.footprints.reshape(-1, 3)
            centres = [one.centre for one in self._picture.frustums]
            places = np.vstack((grounds, *centres, self._stage.middle))
            pose = pose_around(places, FROM_SOUTH, FIELD_OF_VIEW, camera.aspect)
            self._whole = pose.position, camera.aspect
            self._look(pose)
        else:
            self._whole = None
            narrower = np.tan(FIELD_OF_VIEW / 2) * min(camera.aspect, 1.0)
            away = FROM_SOUTH / np.linalg.norm(FROM_SOUTH) * 0.14 * reach / narrower
            self._look(Pose(pointed.position + away, pointed.position, UP, FIELD_OF_VIEW))

    def _look(self, pose: Pose) -> None:
        """Put the eye somewhere."""
        camera = self._client.camera
        with self._client.atomic():
            camera.position = pose.position
            camera.look_at = pose.look_at
            camera.up_direction = pose.up
            camera.fov = pose.fov

    def _fly(self, inside: FrustumPicture | None) -> None:
        """Send the eye into a perspective centre, or back to where it was before."""
        camera = self._client.camera
        here = Pose(camera.position, camera.look_at, camera.up_direction, camera.fov)
        if inside is None:
            there, self._outside = self._outside, None
        else:
            self._outside = self._outside or here
            there = pose_inside(inside, self._picture.level_m, camera.aspect)
        if there is not None:
            self._flight = flight_between(here, there)

    def _frustum_of(self, photo_id: str) -> FrustumPicture | None:
        """The frustum of a photo; None without one."""
        return next((one for one in self._picture.frustums if one.photo_id == photo_id), None)

    def _build(self, picture: ScenePicture) -> None:
        for state, look in LOOKS.items():
            size, shape = look.cloud_size, look.cloud_shape
            self._add_cloud(points_node(state), look.colour, shape, size)
        self._add_cloud(CHECKS, looks.CHECK, "square", 1.1)
        self._add_cloud(OTHERS, looks.FADED, "square", 0.35)
        self._add_cloud(TIES, looks.FADED, "square", 1.0)
        for name, colour, thickness in (
            (FOOTPRINTS, looks.FOOTPRINT, 1.4),
            (CHOSEN, looks.CHOSEN, 3.5),
            (ELLIPSES, looks.ELLIPSE, 1.6),
            (CURRENT, looks.CURRENT, 3.0),
            (CURRENT_RAY, looks.CURRENT, 1.4),
            (SPECIALS, looks.CHOSEN, 1.6),
        ):
            self._lines[name] = self._scene.add_line_segments(
                name,
                np.zeros((1, 2, 3)),
                rgb(colour),
                thickness=thickness,
                thickness_units="screen",
            )
        for frustum in picture.frustums:
            self._add_frustum(frustum, picture.depth_m)

    def _add_cloud(self, name: str, colour: str, shape: looks.CloudShape, size: float) -> None:
        self._sizes[name] = size
        self._clouds[name] = self._scene.add_point_cloud(
            name, NOWHERE, rgb(colour), point_size=self._size_of(name), point_shape=shape,
            precision="float32", point_shading="flat", visible=False,
        )  # fmt: skip

    def _size_of(self, name: str) -> float:
        """Size of a point of a cloud, metres; viser draws points twice as large as told."""
        if name == TIES:
            return TIE_PX / 2 * self._pixel_m
        return self._sizes[name] * self._point_m

    def _add_frustum(self, frustum: FrustumPicture, depth_m: float) -> None:
        half = np.tan(frustum.vertical_fov / 2)
        # Viser divides by this so that its volume is that of a unit pyramid.
        by_volume = float(np.cbrt(half * frustum.aspect * half / 3))
        self._frustums[frustum.photo_id] = self._scene.add_camera_frustum(
            photo_node(frustum.photo_id),
            fov=frustum.vertical_fov, aspect=frustum.aspect, scale=depth_m * by_volume,
            thickness=1.6, thickness_units="screen", color=rgb(looks.PHOTO), jpeg_quality=80,
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _show_frustum(self, frustum: FrustumPicture, depth_m: float, visible: bool) -> None:
        if frustum.photo_id not in self._frustums:
            self._add_frustum(frustum, depth_m)
        handle = self._frustums[frustum.photo_id]
        rotation = frustum.object_from_image @ IMAGE_FROM_OPENCV
        chosen = frustum.photo_id == self._options.photo
        colour = looks.CHOSEN if chosen else looks.STALE if frustum.stale else looks.PHOTO
        colour = looks.against(colour, self._options.light)
        shown = (*frustum.centre.tolist(), *rotation.ravel().tolist(), colour)
        if self._is_new(photo_node(frustum.photo_id), shown):
            handle.wxyz = transforms.SO3.from_matrix(rotation).wxyz
            handle.position = frustum.centre
            handle.color = rgb(colour)
        handle.visible = visible

    def _show_sheet(self, name: str) -> None:
        """A mesh where its layer is on, with heights as large as they are drawn."""
        sheet, options = self._sheets[name], self._options
        match name:
            case "/hillshade":
                sheet.visible = not options.hidden & {"hillshade", "terrain"}
            case "/veil":
                sheet.visible = self._frustum_of(options.inside) is not None
            case _:
                sheet.visible = "terrain" not in options.hidden
        relief, level = options.seen_relief, self._picture.level_m
        if self._is_new(f"{name} shown", (relief, level)):
            sheet.scale = (1.0, 1.0, relief)
            sheet.position = (0.0, 0.0, level * (1 - relief))

    def _show_points(self, picture: ScenePicture, options: SceneOptions) -> None:
        """Points by state; with a photo chosen only its own, and all others small and grey."""
        hidden, photo = options.hidden, options.photo
        clouds = [
            *((points_node(name), "points", cloud) for name, cloud in picture.points.items()),
            (CHECKS, "checks", picture.checks),
        ]
        others: list[np.ndarray] = [np.zeros((0, 3))]
        for node, layer, cloud in clouds:
            chosen = cloud.shown_in(photo)
            self._show_cloud(node, cloud.points[chosen], layer not in hidden)
            if layer not in hidden:
                others.append(np.delete(cloud.points, chosen, axis=0))
        self._show_cloud(OTHERS, np.concatenate(others), True)
        chosen = picture.ties_shown(photo, options.rays)
        if "ties" not in hidden:
            colours = looks.ray_colours(picture.rays[chosen])
            self._show_cloud(TIES, picture.ties.points[chosen], True, colours)
        else:
            self._clouds[TIES].visible = False

    def _show_cloud(
        self, name: str, points: Points, visible: bool, colours: looks.Colours | None = None
    ) -> None:
        handle = self._clouds[name]
        if len(points) and self._is_new(name, (points.tobytes(), self._options.seen_relief)):
            places = self._on_ground(points)
            if colours is not None:
                # Viser takes one colour for all, or one for each: a cloud of so many points.
                handle = self._clouds[name] = self._scene.add_point_cloud(
                    name, places, colors=colours, point_size=self._size_of(name),
                    point_shape="circle", precision="float32", point_shading="flat",
                )  # fmt: skip
            else:
                handle.points = places.astype(np.float32)
        handle.visible = visible and len(points) > 0

    def _on_ground(self, places: Points | Segments, lift: float = 1.0) -> np.ndarray:
        """Places on the ground with heights as they are drawn, a little above the drape."""
        return (
            exaggerate_heights(places, self._picture.level_m, self._options.seen_relief)
            + lift * self._lift
        )

    def _show_lines(self, name: str, segments: Segments, visible: bool) -> None:
        handle = self._lines[name]
        if len(segments) and self._is_new(name, (segments.tobytes(), self._options.seen_relief)):
            handle.points = self._on_ground(segments).astype(np.float32)
        handle.visible = visible and len(segments) > 0

    def _show_coloured(
        self, name: str, segments: Segments, colours: looks.Colours, visible: bool
    ) -> None:
        """Lines with a colour each, already where they are drawn."""
        handle = self._lines.get(name)
        shown = visible and len(segments) > 0
        if shown and self._is_new(name, (segments.tobytes(), colours.tobytes())):
            both = np.repeat(_seen_as(colours)[:, None, :], 2, axis=1)
            if handle is not None and len(handle.points) == len(segments):
                handle.points, handle.colors = segments.astype(np.float32), both
            else:
                if handle is not None:
                    handle.remove()
                handle = self._lines[name] = self._scene.add_line_segments(
                    name, segments, colors=both, thickness=2.4, thickness_units="screen"
                )
        if handle is not None:
            handle.visible = shown

    def _show_chosen(self, picture: ScenePicture, photo: str) -> None:
        """The outline of the chosen photo."""
        numbers = [n for n, one in enumerate(picture.frustums) if one.photo_id == photo]
        each = 4 * EDGE_PARTS
        lines = [picture.footprints[n * each : (n + 1) * each] for n in numbers]
        self._show_lines(CHOSEN, np.concatenate([*lines, np.zeros((0, 2, 3))]), True)

    def _show_areas(self, picture: ScenePicture, options: SceneOptions) -> None:
        """Gruber areas without a point; with a photo chosen, its nine."""
        shown = "areas" not in options.hidden
        lines, colours = np.zeros((0, 2, 3)), np.zeros((0, 3), dtype=np.uint8)
        if shown:
            lines, served = area_lines(picture.areas(), options.photo)
            both = np.array([rgb(looks.BARE), rgb(looks.SERVED)], dtype=np.uint8)
            colours = both[served.astype(np.int64)]
        self._show_coloured(AREAS, self._on_ground(lines), colours, shown)

    def _show_vectors(self, picture: ScenePicture, options: SceneOptions) -> None:
        """Misfits lengthened and coloured by their size, and error ellipses enlarged as much."""
        segments, scale = picture.vectors, options.vector_scale
        if options.photo:
            seen = [photo_id == options.photo for _, photo_id in picture.vector_keys]
            segments = segments[np.array(seen, dtype=bool)]
        start, end = self._on_ground(segments, 1.2)[:, 0], segments[:, 1] - segments[:, 0]
        sizes = np.linalg.norm(end, axis=1)
        colours = looks.size_colours(sizes, picture.vectors_top_m)
        longer = np.stack([start, start + end * scale], axis=1)
        self._show_coloured(VECTORS, longer, colours, "vectors" not in options.hidden)
        rings = np.zeros((0, 2, 3))
        if "ellipses" not in options.hidden:
            chosen = picture.ellipses.shown_in(options.photo)
            middles, half_axes = picture.ellipses.points[chosen], picture.half_axes[chosen]
            rings = ellipse_lines(middles, half_axes, scale)
        self._show_lines(ELLIPSES, rings, True)

    def _show_tie_vectors(self, picture: ScenePicture, options: SceneOptions) -> None:
        """Residuals of tie points as one mesh of needles: made when they are first asked for."""
        shown = "tie_vectors" not in options.hidden and len(picture.tie_vectors) > 0
        drawn = id(picture.tie_vectors), options.vector_scale, options.seen_relief
        if shown and self._is_new(TIE_VECTORS, drawn):
            width = 0.12 * self._point_m
            ground = picture.tie_vectors
            start = self._on_ground(ground[:, :1], 1.1)
            away = ground[:, 1] - ground[:, 0]
            sizes = np.linalg.norm(away, axis=1)
            colours = looks.size_colours(sizes, picture.vectors_top_m)
            lifted = np.stack([start[:, 0], start[:, 0] + away], axis=1)
            data = needles_glb(lifted, colours, options.vector_scale, width)
            self._needles = self._scene.add_glb(TIE_VECTORS, data, cast_shadow=False)
        if self._needles is not None:
            self._needles.visible = shown

    def _show_specials(self) -> None:
        """Plumb line and rays of the chosen photo's special points, or of the one looked at."""
        options, pointed = self._options, self._pointed
        frustum = self._frustum_of(options.photo or (pointed.photo_id if pointed else ""))
        lines, names = np.zeros((0, 2, 3)), dict[str, Position]()
        if frustum is not None and "specials" not in options.hidden and not options.inside:
            found = self._picture.specials(frustum.photo_id)
            places = {letter: self._on_ground(place)[0] for letter, place in found.items()}
            lines = np.array([(place, frustum.centre) for place in places.values()])
            names = names_apart(places, LABEL_PX * self._pixel_m)
        if len(lines) and self._is_new(SPECIALS, lines.tobytes()):
            self._lines[SPECIALS].points = lines.astype(np.float32)
        self._lines[SPECIALS].visible = len(lines) > 0
        self._letters.show(names, True)

    def _show_current(self, pointed: Pointed | None) -> None:
        """A ring about the current point, and its ray to the photo it is looked at in."""
        self._pointed = pointed
        if pointed is not None:
            turn = np.linspace(0, 2 * np.pi, RING_PARTS + 1)
            around = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
            ring = pointed.position + around * 1.7 * self._point_m
            self._show_lines(CURRENT, np.stack([ring[:-1], ring[1:]], axis=1), True)
            (place,) = self._on_ground(pointed.position[None])
            ray, handle = np.stack([place, pointed.centre])[None], self._lines[CURRENT_RAY]
            if self._is_new(CURRENT_RAY, ray.tobytes()):
                handle.points = ray.astype(np.float32)
            handle.visible = not self._options.inside
        else:
            self._lines[CURRENT].visible = self._lines[CURRENT_RAY].visible = False

    def _is_new(self, name: str, shown: object) -> bool:
        """True when a node must be sent: what it last showed is remembered."""
        if self._sent.get(name) == shown:
            return False
        self._sent[name] = shown
        return True


def _seen_as(colours: UInt8[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """What to give for lines to be seen in these colours: viser takes their parts for light."""
    # source: IEC 61966-2-1, the curve of sRGB, here as a power of 2.2.
    return np.rint(255 * (colours / 255.0) ** 2.2).astype(np.uint8)
