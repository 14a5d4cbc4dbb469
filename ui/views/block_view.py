"""The block in 3D as one browser sees it: frustums, drape, points by state, residual vectors."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import viser
from jaxtyping import UInt8
from viser import transforms

from core.arrays import Position
from ui.review import looks
from ui.review.looks import LOOKS, ShownState, rgb
from ui.review.scene import FrustumPicture, Points, ScenePicture, Segments, measure_m
from ui.review.state import SceneOptions
from ui.review.tiles import Colour
from ui.views.meshes import needles_glb

TERRAIN = "/terrain"
FOOTPRINTS = "/footprints"
VECTORS = "/vectors"
CHECKS = "/checks"
TIES = "/ties"
TIE_VECTORS = "/tie_vectors"
CURRENT = "/current"
CURRENT_RAY = "/current_ray"
CURRENT_NAME = "/current_name"
MEASURE = "/measure"
MEASURE_NAME = "/measure_name"
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
RING_PARTS = 28
LIFT = 0.006
"""Points and lines float this share of the block's extent above the drape, to stay visible."""


def photo_node(photo_id: str) -> str:
    """Frustum of one photo."""
    return f"/photos/{_plain(photo_id)}"


def points_node(state: ShownState) -> str:
    """Cloud of the control points in one state."""
    return f"/points/{state}"


def label_node(photo_name: str) -> str:
    """Name of a photo."""
    return f"/labels/{_plain(photo_name)}"


def _plain(name: str) -> str:
    """A name without the separator of the scene tree."""
    return name.replace("/", "_")


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

    name: str
    """Name of the surveyed point."""
    position: Position
    """The surveyed point."""
    centre: Position
    """Perspective centre of the photo it is looked at in."""


class BlockView:
    """The nodes of one browser's scene; built once, then only what changed is sent."""

    def __init__(self, client: viser.ClientHandle, stage: Stage, picture: ScenePicture) -> None:
        self._client = client
        self._scene = client.scene
        self._stage = stage
        self._lift = np.array([0.0, 0.0, LIFT * stage.extent_m])
        self._point_m = POINT_SHARE * stage.extent_m
        self._sizes: dict[str, float] = {}
        self._pointed: Pointed | None = None
        self._frustums: dict[str, viser.CameraFrustumHandle] = {}
        self._clouds: dict[str, viser.PointCloudHandle] = {}
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self._labels: dict[str, viser.LabelHandle] = {}
        self._sent: dict[str, object] = {}
        self._terrain: viser.GlbHandle | None = None
        self._needles: viser.GlbHandle | None = None
        self._terrain_shown = True
        self._build(picture)
        self.fit(None)

    def show(self, picture: ScenePicture, options: SceneOptions, pointed: Pointed | None) -> None:
        """Bring the scene up to date with a picture and a seat's switches."""
        hidden = options.hidden
        self._terrain_shown = "terrain" not in hidden
        if self._terrain is not None:
            self._terrain.visible = self._terrain_shown
        for frustum in picture.frustums:
            self._show_frustum(frustum, picture.depth_m, "photos" not in hidden)
        for state, points in picture.points.items():
            self._show_cloud(points_node(state), points, "points" not in hidden)
        self._show_cloud(CHECKS, picture.checks, "checks" not in hidden)
        self._show_cloud(TIES, picture.ties, "ties" not in hidden)
        self._show_lines(FOOTPRINTS, picture.footprints, "footprints" not in hidden)
        self._show_vectors(picture, options)
        self._show_tie_vectors(picture, options)
        self._show_labels(picture.labels, "labels" not in hidden)
        self._show_current(pointed)

    def drape(self, terrain: bytes) -> None:
        """Lay the terrain, a GLB, under everything."""
        self._terrain = self._scene.add_glb(
            TERRAIN, terrain, cast_shadow=False, visible=self._terrain_shown
        )

    def picture(self, photo_id: str, thumbnail: Colour) -> None:
        """Put a photo's small picture, in the film frame, into its frustum."""
        if photo_id in self._frustums:
            self._frustums[photo_id].image = thumbnail

    def seen_from(self, distance_m: float) -> None:
        """Draw points and ring nearly as large on the screen from wherever they are seen."""
        reach = self._stage.extent_m
        nearness = min(distance_m / (FIT_SHARE * reach), 2.0)
        self._point_m = POINT_SHARE * reach * nearness**0.7
        for name, cloud in self._clouds.items():
            cloud.point_size = self._sizes[name] * self._point_m
        self._show_current(self._pointed)

    def fit(self, pointed: Pointed | None) -> None:
        """Look at the whole block from the south, or at what is current."""
        reach = self._stage.extent_m
        target = self._stage.middle if pointed is None else pointed.position
        if pointed is None:
            # Between ground and photos, so that both are in sight.
            target = target + np.array([0.0, 0.0, 0.14 * reach])
        camera = self._client.camera
        narrower = np.tan(FIELD_OF_VIEW / 2) * min(camera.aspect, 1.0)
        distance = 0.56 * reach / narrower * (1.0 if pointed is None else 0.25)
        away = FROM_SOUTH / np.linalg.norm(FROM_SOUTH) * distance
        with self._client.atomic():
            camera.max_orbit_distance = 30 * reach
            camera.up_direction = (0.0, 0.0, 1.0)
            camera.near, camera.far = reach * 1e-3, reach * 40
            camera.fov = FIELD_OF_VIEW
            camera.position = target + away
            camera.look_at = target

    def _build(self, picture: ScenePicture) -> None:
        for state, look in LOOKS.items():
            size, shape = look.cloud_size, look.cloud_shape
            self._add_cloud(points_node(state), look.colour, shape, size)
        self._add_cloud(CHECKS, looks.CHECK, "square", 1.1)
        self._add_cloud(TIES, looks.TIE, "square", 0.3)
        for name, colour, thickness in (
            (FOOTPRINTS, looks.FOOTPRINT, 1.4),
            (VECTORS, looks.CURRENT, 2.4),
            (CURRENT, looks.CURRENT, 3.0),
            (CURRENT_RAY, looks.CURRENT, 1.4),
            (MEASURE, looks.FOOTPRINT, 3.0),
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
            name, NOWHERE, rgb(colour), point_size=size * self._point_m, point_shape=shape,
            precision="float32", point_shading="flat", visible=False,
        )  # fmt: skip

    def _add_frustum(self, frustum: FrustumPicture, depth_m: float) -> None:
        half = np.tan(frustum.vertical_fov / 2)
        # Viser divides by this so that its volume is that of a unit pyramid.
        by_volume = float(np.cbrt(half * frustum.aspect * half / 3))
        self._frustums[frustum.photo_id] = self._scene.add_camera_frustum(
            photo_node(frustum.photo_id),
            fov=frustum.vertical_fov,
            aspect=frustum.aspect,
            scale=depth_m * by_volume,
            thickness=1.6,
            thickness_units="screen",
            color=rgb(looks.PHOTO),
            jpeg_quality=80,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _show_frustum(self, frustum: FrustumPicture, depth_m: float, visible: bool) -> None:
        if frustum.photo_id not in self._frustums:
            self._add_frustum(frustum, depth_m)
        handle = self._frustums[frustum.photo_id]
        rotation = frustum.object_from_image @ IMAGE_FROM_OPENCV
        colour = looks.STALE if frustum.stale else looks.PHOTO
        shown = (*frustum.centre.tolist(), *rotation.ravel().tolist(), colour)
        if self._is_new(photo_node(frustum.photo_id), shown):
            handle.wxyz = transforms.SO3.from_matrix(rotation).wxyz
            handle.position = frustum.centre
            handle.color = rgb(colour)
        handle.visible = visible

    def _show_cloud(self, name: str, points: Points, visible: bool) -> None:
        handle = self._clouds[name]
        if len(points) and self._is_new(name, points.tobytes()):
            handle.points = (points + self._lift).astype(np.float32)
        handle.visible = visible and len(points) > 0

    def _show_lines(self, name: str, segments: Segments, visible: bool) -> None:
        handle = self._lines[name]
        if len(segments) and self._is_new(name, segments.tobytes()):
            handle.points = (segments + self._lift).astype(np.float32)
        handle.visible = visible and len(segments) > 0

    def _show_vectors(self, picture: ScenePicture, options: SceneOptions) -> None:
        """Misfits lengthened, coloured by their size up to the length of the arrow of scale."""
        handle, segments, scale = self._lines[VECTORS], picture.vectors, options.vector_scale
        measure = measure_m(self._stage.extent_m, scale)
        if len(segments) and self._is_new(VECTORS, (segments.tobytes(), scale)):
            start, end = segments[:, 0], segments[:, 1]
            longer = start + (end - start) * scale
            points = np.stack([start, longer], axis=1) + 1.2 * self._lift
            sizes = np.linalg.norm(end - start, axis=1)
            colours = _seen_as(looks.size_colours(sizes, measure))
            colours = np.repeat(colours[:, None, :], 2, axis=1)
            if len(handle.points) == len(points):
                handle.points, handle.colors = points.astype(np.float32), colours
            else:
                handle.remove()
                handle = self._lines[VECTORS] = self._scene.add_line_segments(
                    VECTORS, points, colors=colours, thickness=2.4, thickness_units="screen"
                )
        handle.visible = "vectors" not in options.hidden and len(segments) > 0
        self._show_measure(measure, scale, bool(handle.visible))

    def _show_measure(self, measure: float, scale: float, visible: bool) -> None:
        """An arrow of a round length south of the block, as many times longer as the vectors."""
        reach = self._stage.extent_m
        start = self._stage.middle + np.array([-0.5 * reach, -0.56 * reach, 0.0])
        along = np.array([measure * scale, 0.0, 0.0])
        barb = 0.12 * along[0]
        tip = start + along
        barbs = [np.stack([tip, tip + np.array([-barb, side * barb, 0.0])]) for side in (-1, 1)]
        self._show_lines(MEASURE, np.stack([np.stack([start, tip]), *barbs]), visible)
        self._show_name(MEASURE_NAME, f"{measure:g} m", tip + self._lift, visible)

    def _show_tie_vectors(self, picture: ScenePicture, options: SceneOptions) -> None:
        """Residuals of tie points as one mesh of needles: made when they are first asked for."""
        shown = "tie_vectors" not in options.hidden and len(picture.tie_vectors) > 0
        if shown and self._is_new(TIE_VECTORS, (id(picture.tie_vectors), options.vector_scale)):
            width = 0.12 * self._point_m
            data = needles_glb(picture.tie_vectors, options.vector_scale, width, 1.1 * self._lift)
            self._needles = self._scene.add_glb(TIE_VECTORS, data, cast_shadow=False)
        if self._needles is not None:
            self._needles.visible = shown

    def _show_labels(self, labels: Mapping[str, Position], visible: bool) -> None:
        """Names of photos are made when they are first asked for."""
        for name, position in labels.items():
            self._show_name(label_node(name), name, position, visible)

    def _show_name(self, node: str, text: str, position: Position, visible: bool) -> None:
        """A name at a place; a node is made when it is first seen, for names are the slowest."""
        label = self._labels.get(node)
        if visible and self._is_new(node, (text, *np.asarray(position).tolist())):
            if label is not None:
                label.remove()
            label = self._labels[node] = self._scene.add_label(
                node, text, position=position, font_screen_scale=0.85
            )
        if label is not None:
            label.visible = visible

    def _show_current(self, pointed: Pointed | None) -> None:
        """A ring about the current point, and its ray to the photo it is looked at in."""
        self._pointed = pointed
        if pointed is not None:
            turn = np.linspace(0, 2 * np.pi, RING_PARTS + 1)
            around = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
            ring = pointed.position + around * 1.7 * self._point_m
            self._show_lines(CURRENT, np.stack([ring[:-1], ring[1:]], axis=1), True)
            ray = np.stack([pointed.position, pointed.centre - self._lift])[None]
            self._show_lines(CURRENT_RAY, ray, True)
            self._show_name(CURRENT_NAME, pointed.name, pointed.position + 4 * self._lift, True)
        else:
            self._show_name(CURRENT_NAME, "", NOWHERE[0], False)
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
