"""Reading a mosaic at planned places: what a gesture comes to, and what an observer is shown.

An observer sees neither what the program thinks nor what others read. Every observer has an order
of places and views of their own, so that no two are led by the same hand.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from core.quality.check_plan import CheckPlace
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.readings import PlanFigures, ReadingFigures, doubled_least
from sessions.checks import (
    StandingPlan,
    judged_parts,
    readings_of,
    standing_plans,
    standing_signatures,
)
from sessions.decisions import (
    Decision,
    PlanChecks,
    ReadCheck,
    Recorded,
    Remark,
    SignBlock,
)
from sessions.products import digest_of
from sessions.remarks import is_fault, standing_faults
from ui.review.check_gestures import BlockSigned, CheckRead, Remarked, Reviewed, SheetJudged
from ui.review.drafts import ASKING_SIGMA
from ui.review.judgement import judge_desk
from ui.review.mosaic import expected_sigma_m
from ui.review.sheet_samples import decided_sheet
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Notice

Part = dict[str, Any]
Readings = Mapping[tuple[str, str], tuple[Recorded, ReadCheck]]
"""The newest reading of every place by every observer, by (place, observer)."""
SHOWN_PX = 300
"""Width of ground that a view opens on, in pixels of what is read: about two of the screen for one,
as the two pictures of a point begin."""
USUAL_PIXEL_M = 0.5
ASIDE = 0.2
"""The middle of a view lies up to this share of its width beside the place: nobody reads the
difference of two middles."""
UNFIT = 2
"""Gravity of a finding with which a block is not good enough."""


def decided_judgement(
    gesture: Reviewed, desk: DeskSnapshot, operator: str
) -> tuple[tuple[Decision, ...], Notice | None]:
    """The decision of a gesture, or what stands against it."""
    if isinstance(gesture, CheckRead | SheetJudged):
        shown = desk.state.mosaic
        if shown is not None and not desk.mosaic_version:
            return (), Notice("notice.check-gone", grave=True)
        if shown is not None and gesture.version != shown.version:
            return (), Notice("notice.check-renewed", grave=True)
    if isinstance(gesture, SheetJudged):
        return decided_sheet(gesture, desk)
    if isinstance(gesture, CheckRead):
        read = decided_reading(gesture, desk.recorded, desk.mosaic_version)
        # A plan that was drawn elsewhere meanwhile has other places.
        lost = bool(desk.mosaic_version) and not read
        return read, Notice("notice.check-replanned", grave=True) if lost else None
    if isinstance(gesture, Remarked):
        return decided_remark(gesture.said, desk)
    return _decided_signature(gesture, desk, operator)


def _decided_signature(
    gesture: BlockSigned, desk: DeskSnapshot, operator: str
) -> tuple[tuple[SignBlock, ...], Notice | None]:
    """The signature, where the block is as whoever signs has seen it."""
    if desk.state.adjusting:
        return (), Notice("notice.sign-wait")
    if not desk.rules_stand:
        return (), Notice("notice.sign-rules", grave=True)
    on_disk = desk.mosaic_version and desk.state.written and not desk.stale
    if gesture.verdict != "reject" and not on_disk:
        return (), Notice("notice.sign-stale", grave=True)
    if gesture.verdict != "reject" and still_reads(desk, operator, begun=True):
        return (), Notice("notice.sign-reading", grave=True)
    if gesture.verdict != "accept" and not gesture.remark:
        return (), Notice("notice.sign-remark")
    unfit = judge_desk(desk).findings[0].grave == UNFIT
    if gesture.verdict == "accept" and unfit and not gesture.remark:
        return (), Notice("notice.sign-unfit", grave=True)
    judged = parts_now(desk)
    if gesture.judged != judged:
        return (), Notice("notice.sign-renewed", grave=True)
    return (SignBlock(gesture.verdict, gesture.remark, judged),), Notice("notice.signed")


def decided_remark(said: Remark, desk: DeskSnapshot) -> tuple[tuple[Remark, ...], Notice | None]:
    """What is recorded of words; what was said of a fault already is told, and not said twice."""
    if not _is_there(said, desk):
        return (), None
    marked = {str(item.decision_id) for item in desk.recorded if is_fault(item.decision)}
    if said.subject != "decision" or said.name not in marked:
        return (said,), None
    faults = standing_faults(desk.recorded)
    fault = next((one for one in faults if str(one.recorded.decision_id) == said.name), None)
    if fault is None:
        return (), Notice("notice.fault-withdrawn", grave=True)
    if said.closes is not None and said.closes != fault.is_open:
        # What another page did meanwhile is not done again; words that came with it are kept.
        closed = ("notice.fault-closed", "notice.fault-closed-said")
        told = closed if said.closes else ("notice.fault-open", "notice.fault-open-said")
        notice = Notice(told[bool(said.words)], {"who": fault.turned.who}, grave=True)
        return ((replace(said, closes=None),) if said.words else ()), notice
    if fault.answers and said.closes is None and said.words == fault.answers[-1][1].words:
        return (), Notice("notice.fault-said", {"who": fault.answers[-1][0].who})
    return (said,), None


def _is_there(said: Remark, desk: DeskSnapshot) -> bool:
    """Whether the desk knows what words are about."""
    match said.subject:
        case "place":
            return True
        case "photo":
            return said.name in desk.base.photos
        case "point":
            return desk.state.point_of(said.name) is not None
        case "decision":
            return any(str(item.decision_id) == said.name for item in desk.recorded)


def decided_reading(
    gesture: CheckRead, recorded: Sequence[Recorded], version: str
) -> tuple[ReadCheck, ...]:
    """The decision of a gesture; none about a place that the plan does not have.

    A surveyed point lies where it was surveyed, wherever a hand put its mark.

    Args:
        gesture: What was read.
        recorded: Everything decided.
        version: Of the mosaic that is shown; empty where there is none.
    """
    plans = standing_plans(recorded)
    places = {place.place_id: place for place in plans[-1].plan.places} if plans else {}
    place = places.get(gesture.place_id)
    if place is None or not version:
        return ()
    if gesture.reason:
        return (ReadCheck(place.place_id, None, None, version, gesture.reason),)
    surveyed = place.sigma_m > 0
    reference = (place.east, place.north) if surveyed else gesture.reference
    return (ReadCheck(place.place_id, gesture.mosaic, reference, version),)


def seat_checks(operator: str, desk: DeskSnapshot) -> Part:
    """What an observer at the desk is shown."""
    block = desk.state.oriented
    pixels = [photo.ground_pixel_m(block.camera_of(name)) for name, photo in block.photos.items()]
    pixel = float(np.median(pixels)) if pixels else USUAL_PIXEL_M
    shown = desk.state.mosaic
    mosaic = None
    if shown is not None and desk.mosaic_version:
        bounds = [round(value, 2) for value in shown.product.grid.bounds]
        own = shown.product.grid.ground_sample_distance_m
        mosaic = {"version": shown.version, "stale": [], "bounds": bounds, "pixel": own}
        # Nobody reads in both pictures what is finer than the pixel of either.
        pixel = max(pixel, own, desk.ortho_pixel_m)
    plans = standing_plans(desk.recorded)
    places = plans[-1].plan.places if plans else ()
    return {
        **checks_part(desk.recorded, operator, desk.mosaic_version, pixel, rules=desk.rules),
        "mosaic": mosaic,
        "gone": desk.mosaic_gone,
        "sigmas": {place.place_id: expected_sigma_m(place, desk, pixel) for place in places},
        "asking": ASKING_SIGMA,
    }


def checks_part(
    recorded: Sequence[Recorded],
    operator: str,
    version: str,
    pixel_m: float,
    *,
    rules: JobRules = USUAL_RULES,
) -> Part:
    """What an observer is shown: the places in an order of their own, with their own readings.

    Args:
        recorded: Everything decided.
        operator: The observer.
        version: Of the mosaic on disk; empty where there is none.
        pixel_m: Of what is read: the coarsest of scans, mosaic and reference, metres.
        rules: The job's limits: how many a second observer reads.
    """
    plans = standing_plans(recorded)
    if not plans:
        return {"plan": None, "places": [], "wanted": 0}
    newest, read = plans[-1], readings_of(recorded)
    shown = SHOWN_PX * pixel_m
    led = second_places(newest.plan, read, operator, version, rules=rules)
    own = {
        one.place_id: one
        for (_, who), (_, one) in read.items()
        if who == operator and one.version == version
    }
    asked = _asked_for(newest.plan.places, own)
    wanted = wanted_places(newest.plan, read, operator, version, rules=rules)
    return {
        "plan": plan_line(newest),
        "wanted": len(wanted),
        "places": [
            {
                **_shown(place, operator, newest.plan.digest, shown),
                **_own(read.get((place.place_id, operator)), version),
            }
            for place in own_order(newest.plan, operator, led)
            # What was said of a spare stays in sight when its place is opened again.
            if place.place_id in asked | own.keys()
        ],
    }


def _asked_for(places: Sequence[CheckPlace], own: Mapping[str, ReadCheck]) -> set[str]:
    """Places to be read: a spare once the place before it cannot be; nobody chooses it."""
    asked: set[str] = set()
    for place in places:
        before = own.get(place.after)
        passed = place.after in asked and before is not None and before.mosaic is None
        if passed or not place.after:
            asked.add(place.place_id)
    return asked


def plan_line(one: StandingPlan) -> Part:
    """A plan in one line."""
    plan = one.plan
    return {
        "when": one.recorded.when[:16].replace("T", " "),
        "who": one.recorded.who,
        "count": plan.count,
        "cells": list(plan.cells),
        "source": plan.source,
        "digest": plan.digest,
        "beforehand": plan.beforehand,
        "unchanged": one.unchanged,
    }


def own_order(plan: PlanChecks, operator: str, led: Collection[str] = ()) -> tuple[CheckPlace, ...]:
    """The places in the order in which one observer reads them, each followed by its spares.

    Those they are led to come first, so that nobody is told which they are.
    """
    cells: list[list[CheckPlace]] = []
    for place in plan.places:
        if place.after:
            cells[-1].append(place)
        else:
            cells.append([place])
    order = _chance(operator, plan.digest, "order").permutation(len(cells))
    mixed = sorted((cells[number] for number in order), key=lambda c: c[0].place_id not in led)
    return tuple(place for cell in mixed for place in cell)


def second_places(
    plan: PlanChecks,
    read: Readings,
    operator: str,
    version: str,
    *,
    rules: JobRules = USUAL_RULES,
) -> frozenset[str]:
    """Places that an observer is led to because one other has read them: so many as are wanted.

    The first ones that were read count, and what the observer read before others did does not:
    the places keep their order however much is read meanwhile.

    Args:
        plan: The plan.
        read: The newest readings.
        operator: The observer.
        version: Of the mosaic.
        rules: The job's limits.
    """
    numbers: dict[str, int] = {}
    twice = 0
    for place in (one for one in plan.places if not one.after):
        said = {
            who: item.decision_id
            for (name, who), (item, one) in read.items()
            if (name, one.version) == (place.place_id, version) and one.mosaic is not None
        }
        own = said.pop(operator, None)
        before = sorted(number for number in said.values() if own is None or number < own)
        twice += len(before) > 1
        if len(before) == 1:
            numbers[place.place_id] = before[0]
    wanted = max(0, doubled_least(plan.count, rules) - twice)
    return frozenset(sorted(numbers, key=numbers.__getitem__)[:wanted])


def wanted_places(
    plan: PlanChecks,
    read: Readings,
    operator: str,
    version: str,
    *,
    rules: JobRules = USUAL_RULES,
) -> frozenset[str]:
    """Places that an observer is to read: all, but where another began to read before them.

    Whoever comes second is wanted at the places they are led to.
    """
    names = frozenset(place.place_id for place in plan.places if not place.after)
    begun = [
        (item.decision_id, who)
        for (name, who), (item, one) in read.items()
        if name in names and one.version == version
    ]
    if not begun or min(begun)[1] == operator:
        return names
    return second_places(plan, read, operator, version, rules=rules)


def still_reads(desk: DeskSnapshot, operator: str, *, begun: bool = False) -> bool:
    """Whether an observer has places of the newest plan left to read, or is wanted as a second.

    Who has read nothing may be the second as long as one is wanted; `begun` leaves them out.
    """
    plans = standing_plans(desk.recorded)
    if not plans:
        return False
    plan, version = plans[-1].plan, desk.mosaic_version
    read = readings_of(desk.recorded)
    names = {place.place_id for place in plan.places if not place.after}
    own = {
        name for (name, who), (_, one) in read.items() if who == operator and one.version == version
    } & names
    if not own:
        return not begun and bool(second_places(plan, read, operator, version, rules=desk.rules))
    return not wanted_places(plan, read, operator, version, rules=desk.rules) <= own


def _shown(place: CheckPlace, operator: str, digest: str, shown_m: float) -> Part:
    """A place and where the observer's two views begin."""
    aside = ASIDE * shown_m * _chance(operator, digest, place.place_id).uniform(-1, 1, (2, 2))
    middles = np.round(aside + np.array([place.east, place.north]), 2)
    return {
        "place": place.place_id,
        "after": place.after,
        "at": [place.east, place.north],
        "surveyed": place.sigma_m > 0,
        "views": middles.tolist(),
        "width": round(shown_m, 2),
    }


def _own(known: tuple[Recorded, ReadCheck] | None, version: str) -> Part:
    """What the observer read; of another mosaic it has to be read again."""
    if known is None:
        return {"state": "open"}
    item, said = known
    if said.version != version:
        return {"state": "outdated", "decision": item.decision_id}
    if said.mosaic is None or said.reference is None:
        return {"state": "unreadable", "reason": said.reason, "decision": item.decision_id}
    return {
        "state": "read",
        "marks": [list(said.mosaic), list(said.reference)],
        "decision": item.decision_id,
    }


def _chance(*names: str) -> np.random.Generator:
    """Random numbers that are the same for the same names."""
    return np.random.default_rng(int(digest_of(*names)[:16], 16))


def parts_now(desk: DeskSnapshot) -> Mapping[str, str]:
    """Digest of each part that a signature is about."""
    report, version = desk.state.report, desk.mosaic_version
    return judged_parts(desk.recorded, report, version, desk.rules, desk.sheets)


def signatures_part(desk: DeskSnapshot, now: Mapping[str, str]) -> list[Part]:
    """Who has vouched for the block, and what of its parts as they are now has changed since."""
    return [
        {
            "id": one.recorded.decision_id,
            "who": one.recorded.who,
            "when": one.recorded.when[:16].replace("T", " "),
            "verdict": one.said.verdict,
            "remark": one.said.remark,
            "digest": one.digest,
            "changed": list(one.changed),
        }
        for one in standing_signatures(desk.recorded, now)
    ]


def figures_told(found: ReadingFigures) -> Part:
    """Figures of readings as the page prints them."""
    return {
        "planned": found.planned,
        "read": found.read,
        "unreadable": found.unreadable,
        "doubled": found.doubled,
        "together": _told(found.together),
        "observers": [[who, _told(one)] for who, one in found.by_observer.items()],
        "pairs": [[one.first, one.second, _told(one.figures)] for one in found.pairs],
        "observer": _number(found.observer_m),
        "share": _number(100 * found.observer_share, 0),
    }


def _told(one: PlanFigures) -> Part:
    return {
        "count": one.count,
        "mean": [_number(value) for value in one.mean_m],
        "shifted": list(one.shifted),
        "scatter": [_number(value) for value in one.deviation_m],
        "rms": [_number(value) for value in one.rms_m],
        "mp": _number(one.m_p),
        "interval": [_number(value) for value in one.m_p_interval],
        "ce90": _number(one.circular_error_90),
        "nmad": [_number(value) for value in one.nmad_m],
        "extreme": [_number(value) for value in one.extreme_m],
    }


def _number(value: float, digits: int = 3) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None
