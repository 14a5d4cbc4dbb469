"""Scans of one camera together: marks without a certificate, ways to lie, blanks and doubles."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.errors import ScanError
from core.geometry.camera import Camera
from core.scans.camera_group import estimate_marks, settle_family
from core.scans.interior_orientation import ScanOrientation, orient_scan
from core.scans.judging import REPEATED, doubt_of_repeated
from core.scans.naming import CORNERS, SIDES
from core.scans.scan_pairs import front_is, same_photo
from tests.core.scans.film_maker import FIDUCIALS, Film, make_film, write_gray

pytestmark = pytest.mark.slow

CAMERA = Camera("little", 60.0, (60.0, 60.0))
ODD = {"1": (-26.4, 26.0), "2": (26.0, 25.6), "3": (25.5, -26.0), "4": (-26.0, -26.3)}


@pytest.fixture(scope="module")
def uncertified(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], ScanOrientation]:
    """Scans whose camera has no certificate, each oriented once: it takes many seconds."""
    folder = tmp_path_factory.mktemp("uncertified")

    @cache
    def oriented(seed: int) -> ScanOrientation:
        path = folder / f"p{seed}.tif"
        make_film(path, Film(turn_deg=0.4 * seed, shrinkage=(1.0, 1.0)), seed)
        return orient_scan(path, CAMERA, 40.0)

    return oriented


def test_marks_without_certificate_follow_from_all_photos__truth(
    uncertified: Callable[[int], ScanOrientation],
) -> None:
    oriented = {one.photo_id: one for one in map(uncertified, range(2))}
    family = settle_family(oriented, CAMERA, dict.fromkeys(oriented, 0.04))
    assert [doubt.kind for doubt in family.doubts] == ["fiducials-estimated"]
    places = np.array([family.camera.fiducials_mm[name] for name in ("UL", "UR", "LR", "LL")])
    assert places == pytest.approx(np.array(list(FIDUCIALS.values())), abs=0.02)
    for scan in family.oriented.values():
        assert len(scan.interior.names) >= 3
        assert scan.interior.rms_um < 5


def test_marks_that_only_repeat_are_told_until_another_scan_has_them__truth(
    uncertified: Callable[[int], ScanOrientation],
) -> None:
    oriented: dict[str, ScanOrientation] = {}
    for one in map(uncertified, range(2)):
        told = tuple(doubt_of_repeated(one.photo_id, mark) for mark in one.fiducials)
        oriented[one.photo_id] = replace(one, doubts=told)
    alone = {name: oriented[name] for name in ("p0",)}
    assert told_of(settle_family(alone, CAMERA, {"p0": 0.04}).oriented["p0"]) == set(CORNERS)
    settled = settle_family(oriented, CAMERA, dict.fromkeys(oriented, 0.04)).oriented
    assert not any(told_of(scan) for scan in settled.values())


def told_of(scan: ScanOrientation) -> set[str]:
    """Marks of which it is told that they stand only because they repeat."""
    return {str(doubt.evidence["fiducial"]) for doubt in scan.doubts if REPEATED in doubt.evidence}


def test_points_further_out_are_no_other_scale_of_the_film__law() -> None:
    """Alike at all marks, both look like one similarity."""
    inner = {name: (x * 26.0, y * 26.0) for name, (x, y) in SIDES.items()}
    outer = {name: (x * 27.0, y * 27.0) for name, (x, y) in SIDES.items()}
    apart = estimate_marks({"a": inner, "b": outer})
    alike = estimate_marks({"a": inner, "b": inner, "c": outer})
    assert apart is not None
    assert alike is not None
    assert not apart.agreed
    assert alike.agreed == {(p, n) for p in ("a", "b") for n in SIDES}


def test_mirrored_film_is_told_by_its_marks__truth(tmp_path: Path) -> None:
    camera = replace(CAMERA, fiducials_mm=ODD)
    truth = make_film(tmp_path / "m.tif", Film(mirrored=True, quarter=1, fiducials=ODD), 4)
    found = orient_scan(tmp_path / "m.tif", camera, 40.0)
    assert found.interior.mirrored
    assert "scan-mirrored" in {doubt.kind for doubt in found.doubts}
    for mark in found.fiducials:
        assert np.hypot(mark.column - truth[mark.name][0], mark.row - truth[mark.name][1]) < 0.15


def test_marks_of_another_camera_are_told__truth(tmp_path: Path) -> None:
    make_film(tmp_path / "o.tif", Film(), 5)
    other = {"1": (0.0, 27.0), "2": (27.0, 0.0), "3": (0.0, -27.0), "4": (-27.0, 0.0)}
    found = orient_scan(tmp_path / "o.tif", replace(CAMERA, fiducials_mm=other), 40.0)
    kinds = {doubt.kind for doubt in found.doubts}
    assert {"fiducials-of-another-camera", "interior-nominal"} <= kinds


def test_blank_scan_is_refused__truth(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(120, 4, (1500, 1500))
    write_gray(tmp_path / "b.tif", noise.astype(np.uint8))
    with pytest.raises(ScanError, match="blank"):
        orient_scan(tmp_path / "b.tif", CAMERA, 40.0)


def test_two_scans_of_one_photo_are_told__truth(tmp_path: Path) -> None:
    make_film(tmp_path / "a.tif", Film(), 6)
    make_film(tmp_path / "c.tif", Film(), 7)
    gray = cv2.imread(str(tmp_path / "a.tif"), cv2.IMREAD_GRAYSCALE)
    write_gray(tmp_path / "b.tif", np.ascontiguousarray(np.rot90(gray)))
    certified = replace(CAMERA, fiducials_mm=FIDUCIALS)
    looks = {n: orient_scan(tmp_path / f"{n}.tif", certified, 40.0).look for n in "abc"}
    doubts = same_photo(looks)
    assert [(doubt.kind, doubt.subject) for doubt in doubts] == [("same-photo", "b")]


@pytest.mark.parametrize("kind", ["notch", "corner", "ringed-saltire", "dotted-cross"])
def test_more_kinds_of_marks__truth(tmp_path: Path, kind: str) -> None:
    sides = {"5": (0.1, 26.5), "6": (26.2, -0.3), "7": (-0.2, -26.4), "8": (-26.6, 0.2)}
    marks = sides if kind == "notch" else ODD
    truth = make_film(tmp_path / "k.tif", Film(kind=kind, fiducials=marks), 8)
    found = orient_scan(tmp_path / "k.tif", replace(CAMERA, fiducials_mm=marks), 40.0)
    assert len(found.fiducials) == 4
    for mark in found.fiducials:
        away = np.hypot(mark.column - truth[mark.name][0], mark.row - truth[mark.name][1])
        assert away < 0.2


def test_the_front_is_where_clear_marks_say__law() -> None:
    sides = {"a": False, "b": True, "c": False}
    assert front_is(sides, {}) is False
    assert front_is(sides, {"b": False}) is True
    assert front_is(sides, {"a": True, "c": True}) is True
    assert front_is({"a": False, "b": True}, {}) is None


def test_neighbours_bring_back_a_scan_that_marks_took_for_mirrored__truth(tmp_path: Path) -> None:
    """Three scans of one ground, as it is; the marks of one were named as if seen from behind."""
    oriented, certified = {}, replace(CAMERA, fiducials_mm=FIDUCIALS)
    for name in "abc":
        make_film(tmp_path / f"{name}.tif", Film(turn_deg=0.0), 7)
        oriented[name] = orient_scan(tmp_path / f"{name}.tif", certified, 40.0)
    oriented["c"] = replace(oriented["c"], way=(0, True), rivals=((0, False),))
    family = settle_family(oriented, certified, dict.fromkeys(oriented, 0.04))
    assert {scan.way for scan in family.oriented.values()} == {(0, False)}
    assert not family.oriented["c"].interior.mirrored
