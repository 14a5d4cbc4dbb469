"""The fiducial board: all photos by all marks, worst first, and the deformation of the films."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from core.arrays import FilmPoints
from core.block import Photo
from core.doubts import Doubt
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation, film_shape, limit_um, plain_similarity
from core.geometry.transforms import PlaneTransform
from core.scans.corrected_marks import MarkChange, corrected_scan
from core.scans.interior_orientation import ScanOrientation
from core.scans.judging import FiducialMeasurement
from sessions.decisions import FillMarks, JudgeFiducial, PlaceFiducial, Recorded, standing
from sessions.scan_decisions import mark_changes
from ui.review.compare import Drawn
from ui.review.doubtful import FIDUCIAL_SIGMAS, FIDUCIAL_UM
from ui.review.drafts import mark_effect
from ui.review.looks import round_all, short
from ui.review.state import DeskState, InitialState, Seat

Part = dict[str, Any]
MarkState = Literal["used", "filled", "placed", "hidden", "unused", "missing"]
"""In use as found, in use as found by an example and not looked at yet, in use as placed by hand,
left out by a person, left out by the fit, not found."""
WINDOW_MM = 3.4
"""Side of the film about a mark that a thumbnail shows, millimetres."""
LEAST_PX, MOST_PX = 32, 1024
"""Limits of that side, scan pixels."""
UNLIKE, UNLIKE_AT = 0.75, 0.35
"""Likeness below which a mark begins to be doubtful, and where it is wholly so."""
APART_PX = 1.0
"""Distance between the two middles of a mark that makes it wholly doubtful, pixels."""
LEAST_FILMS = 2
"""Films of a camera from which there is a mean over the roll."""


def board_part(
    state: DeskState, initial: InitialState, drawn: Drawn, recorded: Sequence[Recorded]
) -> Part:
    """Rows of photos, worst first, each with a cell for every mark of its camera.

    Photos of cameras without marks come last: what they are oriented by is to be seen, too.
    """
    changes, last = mark_changes(recorded), _last_said(recorded)
    photos: list[Part] = []
    for name, photo in state.block.photos.items():
        camera = state.block.camera_of(name)
        film, own = initial.films.get(name), changes.get(name, {})
        row = _Row(photo, camera, film, own, _doubts(film, camera, own))
        certified = initial.cameras.get(photo.camera, camera).fiducials_mm
        cells = [row.cell(mark, last.get((name, mark))) for mark in row.names]
        interior = photo.interior
        photos.append(
            {
                "photo": name,
                "camera": photo.camera,
                "certified": bool(certified),
                "size": list(photo.size_px),
                "version": drawn[name].version if name in drawn else 1,
                "window": _window_px(interior.pixel_size_mm),
                "pixel_um": short(1000 * interior.pixel_size_mm, 3),
                "model": interior.model,
                "rms": short(interior.rms_um, 1) if interior.names else None,
                "redundancy": interior.redundancy,
                "doubt": max((cell["doubt"] for cell in cells), default=0.0),
                "why": [doubt.message for doubt in row.doubts if _of_scan(doubt)],
                "cells": cells,
            }
        )
    photos.sort(
        key=lambda row: (not row["cells"], -row["doubt"], -sum(c["doubt"] for c in row["cells"]))
    )
    return {"photos": photos, "films": films_part(state, initial), "examples": examples(recorded)}


def board_drafts_part(
    seat: Seat, state: DeskState, initial: InitialState, recorded: Sequence[Recorded]
) -> list[Part]:
    """The drafts of a seat, each with what keeping it would make of its scan."""
    parts: list[Part] = []
    for mark in seat.marks:
        effect = mark_effect(state, initial, recorded, mark)
        parts.append(
            {
                "photo": mark.photo_id,
                "name": mark.name,
                "place": round_all((mark.column, mark.row), 2),
                "rms": short(effect.interior.rms_um, 1) if effect.interior.names else None,
                "off": short(effect.length_um, 1),
                "against": effect.is_against,
                "asking": seat.asking == mark,
            }
        )
    return parts


def examples(recorded: Sequence[Recorded]) -> list[Part]:
    """Marks that were shown as examples, with what was found by each."""
    return [
        {
            "id": item.decision_id,
            "camera": item.decision.camera,
            "photo": item.decision.photo_id,
            "place": [item.decision.column, item.decision.row],
        }
        for item in standing(recorded)
        if isinstance(item.decision, FillMarks)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """One photo's marks."""

    photo: Photo
    camera: Camera
    film: ScanOrientation | None
    changes: Mapping[str, MarkChange]
    doubts: tuple[Doubt, ...]

    @property
    def names(self) -> list[str]:
        """Marks of the camera; where nobody certified them, those of the scan."""
        return list(self.camera.fiducials_mm) or list(self.photo.interior.names)

    def cell(self, name: str, said: Recorded | None) -> Part:
        """All about one mark."""
        interior, change = self.photo.interior, self.changes.get(name, MarkChange())
        found = self._found(name)
        place = change.place
        used = name in interior.names and (place is None or self._stands(name, place))
        if place is None and found is not None:
            place = (found.column, found.row)
        if place is None and used:
            column, row = interior.pixels[interior.names.index(name)].tolist()
            place = (column, row)
        by_example = said is not None and isinstance(said.decision, FillMarks)
        state = "filled" if used and change.use and by_example else _state(used, change, place)
        residual = self._residual(name, place, used)
        why = [] if said is not None else self._why(name)
        measured = change.measured if change.filled else found if change.place is None else None
        cell: Part = {
            "name": name,
            "state": state,
            "place": round_all(place, 2),
            "expected": self._expected(name),
            "residual": round_all(residual, 1),
            "score": short(measured.correlation, 2) if measured else None,
            "apart": short(measured.disagreement_px, 2) if measured else None,
            "sigma": short(measured.sigma_px, 2) if measured else None,
            "kind": measured.kind if measured else "",
            "why": why,
            "said": None
            if said is None
            else {
                "id": said.decision_id,
                "who": said.who,
                "when": said.when[:16],
                "filled": by_example,
            },
        }
        # Who placed a mark may have missed it: its residual still counts.
        decided = said is not None and state in ("hidden", "used")
        doubt = 0.0 if decided else self._doubt(cell, residual)
        # Nobody has looked at it: half a doubt is left to the best of them.
        cell["doubt"] = round((1 + doubt) / 2 if state == "filled" else doubt, 2)
        return cell

    def _found(self, name: str) -> FiducialMeasurement | None:
        marks = () if self.film is None else self.film.fiducials
        return next((mark for mark in marks if mark.name == name), None)

    def _why(self, name: str) -> list[str]:
        """What the engine doubts about this mark."""
        return [d.message for d in self.doubts if d.evidence.get("fiducial") == name]

    def _stands(self, name: str, place: tuple[float, float]) -> bool:
        """True when the orientation rests on a mark placed by hand, where it was placed."""
        pixel = self.photo.interior.pixels[self.photo.interior.names.index(name)]
        return bool(np.allclose(pixel, place, atol=1e-6))

    def _expected(self, name: str) -> list[float | None] | None:
        """Where the other marks and the certificate put it, scan pixels."""
        certified = self.camera.fiducials_mm.get(name)
        if certified is None:
            return None
        return round_all(self.photo.interior.pixel_from_film(np.array([certified]))[0], 2)

    def _residual(
        self, name: str, place: tuple[float, float] | None, used: bool
    ) -> np.ndarray | None:
        """Measured minus certified, or what it would be for a mark that is not used, um."""
        interior = self.photo.interior
        if used:
            return interior.residuals_um[interior.names.index(name)]
        certified = self.camera.fiducials_mm.get(name)
        if place is None or certified is None or not interior.names:
            return None
        return 1000 * (interior.film_from_pixel(np.array([place]))[0] - np.array(certified))

    def _doubt(self, cell: Part, residual: np.ndarray | None) -> float:
        """From 0 to 1."""
        if cell["state"] == "missing":
            return 0.9
        sigma = np.nan_to_num(self.photo.interior.sigma_um)
        limit = max(FIDUCIAL_SIGMAS * float(sigma), FIDUCIAL_UM)
        length = 0.0 if residual is None else float(np.hypot(*residual))
        bound = limit_um(self.photo.interior.pixel_size_mm)
        # Two measures: one mark far off makes the sigma of its own scan large.
        grounds = [0.5 * min(length / limit, 1.8), 0.9 * min(length / bound, 1.0)]
        grounds.append(0.8 if cell["state"] == "unused" else 0.0)
        if cell["score"] is not None:
            grounds.append(0.8 * min(max((UNLIKE - cell["score"]) / (UNLIKE - UNLIKE_AT), 0), 1))
            grounds.append(0.7 * min(cell["apart"] / APART_PX, 1))
        return max(*grounds, 0.6 if cell["why"] else 0.0)


def _state(used: bool, change: MarkChange, place: tuple[float, float] | None) -> MarkState:
    if not change.use:
        return "hidden"
    if used:
        return "placed" if change.place is not None and not change.filled else "used"
    return "missing" if place is None else "unused"


def _last_said(recorded: Sequence[Recorded]) -> dict[tuple[str, str], Recorded]:
    """The last decision about each mark that stands; that of a person goes before an example."""
    last: dict[tuple[str, str], Recorded] = {}
    for item in standing(recorded):
        match item.decision:
            case JudgeFiducial(photo_id, name) | PlaceFiducial(photo_id, name):
                last[photo_id, name] = item
            case FillMarks(found=found):
                keys = [(photo, mark.name) for photo, marks in found.items() for mark in marks]
                before = {key: last[key] for key in keys if key in last}
                told = {k for k, one in before.items() if not isinstance(one.decision, FillMarks)}
                last |= {key: item for key in keys if key not in told}
            case _:
                pass
    return last


def _doubts(
    film: ScanOrientation | None, camera: Camera, changes: Mapping[str, MarkChange]
) -> tuple[Doubt, ...]:
    """What the engine doubts about a scan, with the marks as they were corrected."""
    if film is None:
        return ()
    if not changes:
        return film.doubts
    return corrected_scan(film, camera, film.interior.pixel_size_mm, changes).doubts


def _of_scan(doubt: Doubt) -> bool:
    """True for doubts about the interior orientation as a whole."""
    kinds = ("fiducial", "interior", "scan-", "film")
    return "fiducial" not in doubt.evidence and doubt.kind.startswith(kinds)


def _window_px(pixel_mm: float) -> int:
    """Side of the scan that a thumbnail shows, even, pixels."""
    side = round(WINDOW_MM / max(pixel_mm, 1e-6) / 2) * 2
    return int(min(max(side, LEAST_PX), MOST_PX))


def films_part(state: DeskState, initial: InitialState) -> Part:
    """Vectors and figures of every film, and of every camera the mean over its roll."""
    block = state.block
    films = [
        _film(photo, block.camera_of(name), initial.pixel_mm.get(name))
        for name, photo in block.photos.items()
        if photo.interior.names
    ]
    cameras = dict.fromkeys(film["camera"] for film in films)
    return {
        "films": films,
        "rolls": {name: _roll([f for f in films if f["camera"] == name]) for name in cameras},
        "frames": {name: list(block.cameras[name].frame_mm) for name in cameras},
    }


def _film(photo: Photo, camera: Camera, pixel_mm: float | None) -> Part:
    """One film; without the scanner's nominal pixel its own mean one tells shape alone."""
    interior = photo.interior
    shape = film_shape(interior, pixel_mm or interior.pixel_size_mm)
    film = interior.film_from_pixel(interior.pixels) - interior.residuals_um / 1000
    plain = _after_similarity(interior)
    marks = [
        [name, *_rounded(place, 3), *_rounded(left, 2), *_rounded(before, 2)]
        for name, place, left, before in zip(
            interior.names, film, interior.residuals_um, plain, strict=True
        )
    ]
    return {
        "photo": photo.photo_id,
        "camera": photo.camera,
        "model": interior.model,
        "marks": marks,
        "scale_x": round(1e6 * (shape.scale_x - 1), 1),
        "scale_y": round(1e6 * (shape.scale_y - 1), 1),
        "shear": round(shape.shear_mrad, 4),
        "rms": round(interior.rms_um, 2),
        "rms_plain": round(float(np.sqrt(np.mean(plain**2))), 2),
        "redundancy": interior.redundancy,
        "chance": round(interior.chance, 4) if interior.redundancy else None,
    }


def _after_similarity(interior: InteriorOrientation) -> FilmPoints:
    """What shift, turn and one scale leave of the marks, micrometres: the film's own shape."""
    fit = plain_similarity(interior)
    if not isinstance(fit, PlaneTransform):
        return np.zeros_like(interior.residuals_um)
    return 1000 * fit.residuals


def _roll(films: Sequence[Part]) -> Part | None:
    """Mean and spread over all films of a camera; None for a single one."""
    if len(films) < LEAST_FILMS:
        return None
    by_mark: dict[str, list[list[float]]] = {}
    for film in films:
        for name, *values in film["marks"]:
            by_mark.setdefault(name, []).append(values)
    marks = [
        [name, *_rounded(np.mean(np.array(rows), axis=0), 2), len(rows)]
        for name, rows in by_mark.items()
    ]
    figures = np.array([[f["scale_x"], f["scale_y"], f["shear"]] for f in films])
    return {
        "count": len(films),
        "marks": marks,
        "mean": _rounded(figures.mean(axis=0), 4),
        "spread": _rounded(figures.std(axis=0, ddof=1), 4),
        "rms": round(float(np.sqrt(np.mean([film["rms"] ** 2 for film in films]))), 2),
    }


def _rounded(values: Any, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
