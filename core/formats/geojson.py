"""GeoJSON with the attributes that Czech theses on archival photos use: points and footprints.

A layer of points a photo, named as its scan: `cross_id` (point), `Z`, `quality`, `X_ref`, `Y_ref`
(where it lies), `x_col`, `y_row` (where the scan shows it, from the centre of the first pixel),
`id`, `RAN_dist_pix` (how far the scan shows it from where it lies, in pixels). Footprints bear the
scan's name as `LMS_TIF_UP`, and our orientation beside it.

Source: thesis on automatic ground control for archival aerial photos, figure 27 and appendices.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    Triple,
    pixels_of,
)
from core.formats.outlines import ground_outline
from core.formats.records import json_numbers, read_json, scan_stem, write_json
from core.formats.rotations import triple_of
from core.frames import HALF_PIXEL
from core.geometry.exterior import ExteriorOrientation
from core.said import say

PHOTOS = "photos.geojson"
"""Layer of the footprints."""
NAME = "LMS_TIF_UP"
"""Attribute with a scan's name."""
POINT_FIELDS = ("cross_id", "X_ref", "Y_ref", "Z", "x_col", "y_row")
"""Attributes that a point must have."""
SAME_M = 0.01  # design: digits that two decimals leave.
"""A point given in several layers is one point within this, metres."""
RESAMPLED = re.compile(r"\d+(?:\.\d+)?m_(?=.)")
"""Begins names of layers whose pixels are those of a copy at so many metres."""
CRS_NAME = re.compile(r"(?:urn:ogc:def:crs:)?([A-Za-z]+):[^:]*:?(\d+)$")
"""How a layer names its CRS."""


def write_geojson(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write a layer of points for every photo that shows some, and one of footprints.

    Returns:
        What was left out.
    """
    path.mkdir(parents=True, exist_ok=True)
    for name, photo in block.photos.items():
        features = list(_points_of(block, photo))
        if features:
            _write(path / f"{name}.geojson", name, features, block.crs)
    outlines: list[dict[str, Any]] = []
    missing = 0
    for photo in block.photos.values():
        ring = ground_outline(block, photo)
        missing += ring is None
        outlines.append(_photo_feature(photo, ring))
    _write(path / PHOTOS, "photos", outlines, block.crs)
    notes: list[str] = []
    if missing:
        notes.append(
            say(
                "{count:# photo has|# photos have} no footprint: orientation, scan size or ground "
                "are unknown.",
                count=missing,
            )
        )
    if len(block.ties.point):
        notes.append(say("Tie points are left out."))
    if block.cameras:
        notes.append(say("The layers hold no cameras and no interior orientations."))
    return tuple(notes)


def _points_of(block: ExchangeBlock, photo: ExchangePhoto) -> Iterator[dict[str, Any]]:
    """The surveyed points that a photo shows."""
    for number, one in enumerate(block.measurements):
        point = block.points.get(one.point_id)
        if one.photo_id != photo.photo_id or point is None:
            continue
        east, north, height = point.position
        off = None
        if photo.exterior is not None and photo.pixel_from_image is not None:
            place = pixels_of(np.array([point.position]), photo, block.camera_of(photo.photo_id))[0]
            distance = float(np.hypot(place[0] - one.column, place[1] - one.row))
            off = distance if np.isfinite(distance) else None
        yield {
            "type": "Feature",
            "properties": {
                "cross_id": one.point_id,
                "Z": height,
                "quality": None,
                "X_ref": east,
                "Y_ref": north,
                "x_col": one.column - HALF_PIXEL,
                "y_row": one.row - HALF_PIXEL,
                "id": number,
                "RAN_dist_pix": off,
                "sigma_pix": one.sigma_px,
                "sigma_m": None if point.sigma_m is None else list(point.sigma_m),
                "role": point.role,
            },
            "geometry": {"type": "Point", "coordinates": [east, north]},
        }


def _photo_feature(photo: ExchangePhoto, ring: list[list[float]] | None) -> dict[str, Any]:
    fields: dict[str, Any] = {NAME: photo.file or photo.photo_id, "camera": photo.camera}
    if photo.exterior is not None:
        turned = photo.exterior
        fields |= dict(zip(("X", "Y", "Z"), turned.centre.tolist(), strict=True))
        angles = np.degrees(turned.angles).tolist()
        fields |= dict(zip(("omega_deg", "phi_deg", "kappa_deg"), angles, strict=True))
        sigmas = (photo.sigma_centre_m, photo.sigma_angles)
        fields["sigma_m"] = None if sigmas[0] is None else list(sigmas[0])
        fields["sigma_deg"] = None if sigmas[1] is None else np.degrees(sigmas[1]).tolist()
    outline = None if ring is None else {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": fields, "geometry": outline}


def _write(path: Path, name: str, features: Sequence[dict[str, Any]], crs: str) -> None:
    layer: dict[str, Any] = {"type": "FeatureCollection", "name": name}
    if re.fullmatch(r"[A-Za-z]+:\d+", crs):
        authority, code = crs.split(":")
        named = f"urn:ogc:def:crs:{authority.upper()}::{code}"
        layer["crs"] = {"type": "name", "properties": {"name": named}}
    layer["features"] = list(features)
    write_json(path, layer)


def read_geojson(path: Path) -> ExchangeBlock:
    """A folder of layers, or one layer of points or footprints.

    Raises:
        ProjectError: A layer is none, lacks an attribute, or contradicts another one.
    """
    files = [path]
    if path.is_dir():
        files = [
            one for one in sorted(path.iterdir()) if one.suffix.lower() in (".geojson", ".json")
        ]
    if not files:
        raise ProjectError(path, "holds no GeoJSON.", "Give the folder that the layers are in.")
    found = _Found()
    layers = {file: _layer(file) for file in files}
    outlines = {file for file, one in layers.items() if any(NAME in row for row in one.fields)}
    for file in sorted(layers, key=lambda file: file not in outlines):
        found.take_crs(file, layers[file].crs)
        if file in outlines:
            found.take_photos(file, layers[file].fields)
        else:
            found.take_points(file, layers[file].fields)
    return found.block()


@dataclass(frozen=True, slots=True)
class _Layer:
    """Attributes of a layer's features, and its CRS."""

    fields: list[Mapping[str, Any]]
    crs: str


def _layer(path: Path) -> _Layer:
    layer = read_json(path)
    features = layer.get("features") if isinstance(layer, dict) else None
    if not isinstance(features, list):
        raise ProjectError(path, "is no GeoJSON layer.", "Export the layer again.")
    fields = [one.get("properties") or {} for one in features if isinstance(one, dict)]
    named = str(((layer.get("crs") or {}).get("properties") or {}).get("name", ""))
    found = CRS_NAME.match(named)
    crs = f"{found[1].upper()}:{found[2]}" if found else named
    return _Layer(cast("list[Mapping[str, Any]]", fields), crs)


class _Found:
    """What was read so far."""

    def __init__(self) -> None:
        self.crs = ""
        self.photos: dict[str, ExchangePhoto] = {}
        self.points: dict[str, ExchangePoint] = {}
        self.measured: dict[tuple[str, str], tuple[float, ExchangeMeasurement]] = {}
        self.resampled: set[str] = set()
        self.doubled = 0

    def take_crs(self, path: Path, crs: str) -> None:
        """Every layer has to lie in one CRS."""
        if crs and self.crs and crs != self.crs:
            raise ProjectError(
                path,
                "is in {crs}, other layers are in {other}.",
                "Export all layers in one CRS.",
                crs=crs,
                other=self.crs,
            )
        self.crs = crs or self.crs

    def take_photos(self, path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
        """Footprints with orientations where they have them."""
        for number, fields in enumerate(rows, 1):
            where = f"{path}:{number}"
            file = str(fields.get(NAME) or "")
            name = scan_stem(file)
            if not name or name in self.photos:
                cause = say("Feature {number} names no scan.", number=number)
                if name:
                    cause = say(
                        "Feature {number}: the scan {scan} stands twice.", number=number, scan=name
                    )
                raise ProjectError(path, cause, "Give every scan one footprint.")
            exterior = None
            if fields.get("X") is not None:
                values = [json_numbers(where, fields, key, 1)[0] for key in ("X", "Y", "Z")]
                keys = ("omega_deg", "phi_deg", "kappa_deg")
                angles = np.radians([json_numbers(where, fields, key, 1)[0] for key in keys])
                exterior = ExteriorOrientation(np.array(values), *angles.tolist())
            sigma = _triple(where, fields, "sigma_deg")
            self.photos[name] = ExchangePhoto(
                name,
                file,
                str(fields.get("camera") or ""),
                exterior=exterior,
                sigma_centre_m=_triple(where, fields, "sigma_m"),
                sigma_angles=None if sigma is None else triple_of(np.radians(sigma)),
            )

    def take_points(self, path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
        """Points of one photo, which the layer is named after."""
        plain = RESAMPLED.sub("", path.stem, count=1)
        photo = scan_stem(plain)
        if plain != path.stem:
            self.resampled.add(photo)
        for number, fields in enumerate(rows, 1):
            missing = [key for key in POINT_FIELDS if fields.get(key) is None]
            if missing:
                raise ProjectError(
                    path,
                    "Feature {number} has no {missing}.",
                    "Points have cross_id, Z, X_ref, Y_ref, x_col, y_row; footprints LMS_TIF_UP.",
                    number=number,
                    missing=missing[0],
                )
            self._take_point(path, number, fields, photo)
        self.photos.setdefault(photo, ExchangePhoto(photo, f"{photo}.tif"))

    def _take_point(self, path: Path, number: int, fields: Mapping[str, Any], photo: str) -> None:
        identity, where = fields["cross_id"], f"{path}:{number}"
        name = str(int(identity)) if isinstance(identity, float) else str(identity)
        keys = ("X_ref", "Y_ref", "Z", "x_col", "y_row")
        east, north, height, column, row = (json_numbers(where, fields, key, 1)[0] for key in keys)
        role = "check" if fields.get("role") == "check" else "control"
        sigma = _triple(where, fields, "sigma_m")
        point = ExchangePoint(name, (east, north, height), sigma, role)
        known = self.points.setdefault(name, point)
        if np.abs(np.array(known.position) - point.position).max() > SAME_M:
            raise ProjectError(
                path,
                "Feature {number}: point {point} lies elsewhere than in another layer.",
                "Give every point one name and one place.",
                number=number,
                point=name,
            )
        quality = float(fields.get("quality") or 0.0)
        given = fields.get("sigma_pix")
        measurement = ExchangeMeasurement(
            name,
            photo,
            column + HALF_PIXEL,
            row + HALF_PIXEL,
            None if given is None else json_numbers(where, fields, "sigma_pix", 1)[0],
        )
        before = self.measured.get((name, photo))
        self.doubled += before is not None
        if before is None or quality > before[0]:
            self.measured[name, photo] = quality, measurement

    def block(self) -> ExchangeBlock:
        """All of it."""
        notes: list[str] = []
        if self.doubled:
            notes.append(
                say(
                    "{count:# candidate|# candidates} of lower quality in a photo left out.",
                    count=self.doubled,
                )
            )
        if self.resampled:
            notes.append(
                say(
                    "Pixels of {count:# photo|# photos} are those of a resampled copy: their "
                    "measurements are left out.",
                    count=len(self.resampled),
                )
            )
        measured = tuple(
            one for _, one in self.measured.values() if one.photo_id not in self.resampled
        )
        return ExchangeBlock(self.crs, {}, self.photos, self.points, measured, notes=tuple(notes))


def _triple(where: str, fields: Mapping[str, Any], key: str) -> Triple | None:
    """An attribute that holds three numbers, where it does."""
    values = fields.get(key)
    if isinstance(values, str):  # GDAL hands lists on as text.
        values = json.loads(values) if values.startswith("[") else None
    if not isinstance(values, list) or len(values) != len("XYZ"):
        return None
    return triple_of(json_numbers(where, {key: values}, key, len("XYZ")))


GEOJSON_FORMAT = ExchangeFormat(
    name="geojson",
    title="GeoJSON: points of each photo, footprints",
    conventions=Conventions(
        pixels="x_col right, y_row down, centre of the first pixel",
        object_space="X_ref, Y_ref easting and northing, Z height, metres; the CRS named in the "
        "layer",
        rotation="omega_deg, phi_deg, kappa_deg of footprints, which are ours: R = R_x R_y R_z "
        "turns image space into object space",
        sigmas="points, measurements and orientations, in attributes of ours",
        lost="cameras, interior orientations, ties, fiducials; points that no photo shows",
        tested="attributes as a published thesis prints them",
    ),
    holds="upright",
    write=write_geojson,
    read=read_geojson,
    default_name="geojson",
)
"""Layers with the attributes of the thesis."""
