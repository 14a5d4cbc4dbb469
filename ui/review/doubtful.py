"""Doubts other than control: tie points that bend the block, photos, fiducials."""

from collections.abc import Iterable, Mapping, Sequence
from math import isnan

import numpy as np

from core.block import Block, Measurement, Photo, Status, SurveyedPoint
from core.doubts import Doubt
from core.geometry.interior import InteriorOrientation
from sessions.decisions import (
    JudgeFiducial,
    JudgePhoto,
    JudgeTie,
    PlaceFiducial,
    Recorded,
    standing,
)
from sessions.replay import tie_at
from ui.review.compare import DrawnPhoto, HeightSource, ground_from_pixel
from ui.review.state import DeskState, DoubtReason, Extra, Key, Kind

Verdict = JudgeTie | JudgePhoto | JudgeFiducial | PlaceFiducial
TIES_SHOWN = 60
"""So many tie points are put into the queue, the worst ones."""
TIE_SIGMAS = 3.7
"""A tie point whose worst ray is further off than this, standard deviations, is looked at: one good
ray in a thousand."""
FEW_RAYS = 12
"""A photo with fewer rays of tie points hardly hangs together with its neighbours."""
FIDUCIAL_SIGMAS, FIDUCIAL_UM = 1.8, 12.0
"""A mark is looked at when its residual exceeds both: sigmas of its scan, and micrometres."""
GROUND_SIGMA_M = np.array([1.0, 1.0, 1.0])


def extra_of(
    state: DeskState,
    base: Block,
    decisions: Sequence[Recorded],
    doubts: Iterable[Doubt],
    dem: HeightSource,
) -> Extra:
    """Everything doubtful beside surveyed points, and what was said of such things before.

    Args:
        state: The block with its newest adjustment.
        base: The block before any decision: what was left out is still there.
        decisions: Everything recorded.
        doubts: What the engine was unsure of.
        dem: Heights, for places on the ground.
    """
    said = [item.decision for item in standing(decisions)]
    verdicts = [item for item in said if isinstance(item, JudgeTie | JudgePhoto | JudgeFiducial)]
    gathered = _Gathered(state, base, dem)
    gathered.ties([item for item in verdicts if isinstance(item, JudgeTie)])
    photos = {item.photo_id: item.use for item in verdicts if isinstance(item, JudgePhoto)}
    gathered.photos(photos, {doubt.subject: doubt.message for doubt in doubts})
    marks = {(v.photo_id, v.name): v.use for v in verdicts if isinstance(v, JudgeFiducial)}
    gathered.fiducials(marks)
    return Extra(gathered.points, gathered.measurements, gathered.kinds, gathered.reasons)


def verdict_on(extra: Extra, key: Key, use: bool) -> Verdict | None:
    """The decision that says whether something takes part."""
    measurement, kind = extra.measurements.get(key), extra.kinds.get(key[0])
    if measurement is None:
        return None
    match kind:
        case "tie":
            return JudgeTie(key[1], measurement.column, measurement.row, use)
        case "photo":
            return JudgePhoto(key[1], use)
        case "fiducial":
            return JudgeFiducial(key[1], key[0].partition(" ")[2], use)
        case _:
            return None


def key_of_verdict(extra: Extra, verdict: Verdict) -> Key | None:
    """The row that a decision was about."""
    match verdict:
        case JudgePhoto(photo_id=photo_id):
            key = f"photo {photo_id}", photo_id
            return key if key in extra.measurements else None
        case (
            JudgeFiducial(photo_id=photo_id, name=name)
            | PlaceFiducial(photo_id=photo_id, name=name)
        ):
            key = f"fiducial {name}", photo_id
            return key if key in extra.measurements else None
        case JudgeTie(photo_id=photo_id, column=column, row=row):
            for key, item in extra.measurements.items():
                same = abs(item.column - column) < 0.5 and abs(item.row - row) < 0.5
                if key[1] == photo_id and extra.kinds[key[0]] == "tie" and same:
                    return key
            return None


class _Gathered:
    """Points and measurements as they come together."""

    def __init__(self, state: DeskState, base: Block, dem: HeightSource) -> None:
        self.state, self.base, self.dem = state, base, dem
        self.oriented = state.oriented
        self.points: dict[str, SurveyedPoint] = {}
        self.measurements: dict[Key, Measurement] = {}
        self.kinds: dict[str, Kind] = {}
        self.reasons: dict[Key, DoubtReason] = {}

    def ties(self, said: Sequence[JudgeTie]) -> None:
        """Tie points with a ray far off, worst first; those judged before stay."""
        judged = {
            number: verdict.use
            for verdict in said
            if (number := tie_at(self.base.ties, verdict.photo_id, verdict.column, verdict.row))
            is not None
        }
        worst = worst_ties(self.state)
        for number in {**dict.fromkeys(judged), **dict.fromkeys(worst)}:
            use = judged.get(number)
            status: Status = "auto" if use is None else "accepted" if use else "rejected"
            self._tie(number, status, worst.get(number, TIE_SIGMAS))

    def photos(self, said: Mapping[str, bool], doubts: Mapping[str, str]) -> None:
        """Photos without an orientation, with a doubt, or with hardly any ties."""
        rays = _rays_by_photo(self.state.block)
        for name, photo in self.base.photos.items():
            placed = self.oriented.photos.get(name, photo)
            few = bool(len(self.base.ties.point)) and rays.get(name, 0) < FEW_RAYS
            remark = doubts.get(name, "")
            if photo.oriented and not remark and not few and name not in said:
                continue
            status: Status = "auto" if photo.oriented else "unused"
            if name in said:
                status = "accepted" if said[name] else "rejected"
            middle = placed.interior.pixel_from_film(np.zeros((1, 2)))
            position = self._ground(name, middle)
            if position is None:
                continue
            key = f"photo {name}", name
            self._add(key, "photo", position, middle[0], 0.3, status, remark)
            if few and not remark:
                self.reasons[key] = DoubtReason("doubt.rays", rays.get(name, 0), 0.7)

    def fiducials(self, said: Mapping[tuple[str, str], bool]) -> None:
        """Marks whose residual stands out within their scan."""
        for photo_id, photo in self.base.photos.items():
            now = self.state.block.photos.get(photo_id, photo)
            # Marks that were left out are only in the block before any decision.
            marks = {**_marks(photo.interior), **_marks(now.interior)}
            sigma_um = now.interior.sigma_um
            limit = max(0.0 if isnan(sigma_um) else FIDUCIAL_SIGMAS * sigma_um, FIDUCIAL_UM)
            for mark, (pixel, length) in marks.items():
                use = said.get((photo_id, mark))
                if use is None and length <= limit:
                    continue
                position = self._ground(photo_id, pixel[None])
                if position is None:
                    continue
                status: Status = "auto" if use is None else "accepted" if use else "rejected"
                score = float(np.clip(1.2 - 0.3 * length / limit, 0.1, 0.9))
                key = f"fiducial {mark}", photo_id
                self._add(key, "fiducial", position, pixel, score, status)
                self.reasons[key] = DoubtReason("doubt.fiducial", length, 1 - score)

    def _tie(self, number: int, status: Status, ratio: float) -> None:
        ties, report = self.base.ties, self.state.report
        rays = np.flatnonzero(ties.point == number)
        if not len(rays):
            return
        position = report.tie_positions[number] if number < len(report.tie_positions) else None
        first = ties.photo_ids[int(ties.photo[rays[0]])]
        if position is None or not np.isfinite(position).all():
            position = self._ground(first, ties.pixels[rays[:1]])
        if position is None:
            return
        score = float(np.clip(1.2 - ratio / (3 * TIE_SIGMAS) - 0.4, 0.05, 0.9))
        for ray in rays:
            key = f"tie {number}", ties.photo_ids[int(ties.photo[ray])]
            self._add(key, "tie", position, ties.pixels[ray], score, status)
            self.reasons[key] = DoubtReason("doubt.tie", ratio, 1 - score)

    def _add(self, key: Key, kind: Kind, position: np.ndarray, pixel: np.ndarray,
             score: float, status: Status, remark: str = "") -> None:  # fmt: skip
        name = key[0]
        self.kinds[name] = kind
        if name not in self.points:
            self.points[name] = SurveyedPoint(name, position, GROUND_SIGMA_M, "control", "hand")
        self.measurements[key] = Measurement(
            *key, float(pixel[0]), float(pixel[1]), 0.5, score, status, remark
        )

    def _ground(self, photo_id: str, pixels: np.ndarray) -> np.ndarray | None:
        """Where a ray meets the ground; None where it does not."""
        photo: Photo | None = self.oriented.photos.get(photo_id)
        if photo is None:
            return None
        drawn = DrawnPhoto(photo, self.oriented.camera_of(photo_id), 0)
        found = ground_from_pixel(pixels, drawn, self.dem, photo.ground_height_m)[0]
        return found if np.isfinite(found).all() else None


def worst_ties(state: DeskState) -> dict[int, float]:
    """Tie points whose worst ray is far off: number and standard deviations, worst first."""
    report = state.report
    ties, residuals = report.block.ties, report.tie_residuals_px
    if not len(ties.point):
        return {}
    unit = max(report.unit, 0.3)
    ratio = np.linalg.norm(residuals, axis=1) / (ties.sigma_px * unit)
    worst = np.zeros(ties.count)
    taking_part = np.isfinite(ratio)
    np.maximum.at(worst, ties.point[taking_part], ratio[taking_part])
    order = np.argsort(-worst)[:TIES_SHOWN]
    return {int(number): float(worst[number]) for number in order if worst[number] > TIE_SIGMAS}


def _marks(interior: InteriorOrientation) -> dict[str, tuple[np.ndarray, float]]:
    """Where each mark in use was measured, pixels, and the length of its residual, um."""
    lengths = np.hypot(*interior.residuals_um.T).tolist() if interior.names else []
    measured = zip(interior.names, interior.pixels, lengths, strict=True)
    return {name: (pixel, length) for name, pixel, length in measured}


def _rays_by_photo(block: Block) -> dict[str, int]:
    counts = np.bincount(block.ties.photo, minlength=len(block.ties.photo_ids))
    return dict(zip(block.ties.photo_ids, counts.tolist(), strict=True))
