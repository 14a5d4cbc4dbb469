"""The desk on a block that was really run: everything shown, decided, adjusted, made again."""

import csv
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from app.run import RunOptions
from app.runners import run_block
from app.terminal import JsonLines
from tests.browser.conftest import PATIENCE_MS, scene_of
from tests.browser.hands import (
    becomes,
    caught_up,
    current,
    look_at,
    place_wrongly,
    press,
    settled,
    sigma,
    state_of,
)
from ui.views import block_view as names
from ui.words.catalogue import words

REMAKING_MS = 3 * PATIENCE_MS
REMADE = f".notice:has-text('{words()['notice.remade']}')"
REPOSITORY = Path(__file__).resolve().parents[2]


def test_frustums_dem_points_and_vectors_are_shown__truth(real_desk, sit_at):
    page = sit_at(real_desk.desk.url)
    scene = scene_of(page)
    photos = page.evaluate("gruber.parts.rows.map(row => row[1])")
    assert len(set(photos)) >= 6
    wanted = [names.TERRAIN, names.VECTORS, names.FOOTPRINTS, names.points_node("auto")]
    wanted += [names.photo_node(photo) for photo in set(photos)]
    # viser gives a node up for a moment when it draws it anew.
    for name in wanted:
        scene.wait_for_function("name => __viserMutable.nodeRefFromName[name]?.visible", arg=name)
    assert not scene.get_by_text("Connected").first.is_visible()


def test_y_n_u_change_state_and_figures__truth(real_desk, sit_at):
    page = sit_at(real_desk.desk.url, scene=False)
    point, before, _ = press(page, "n")
    assert state_of(page, point) == "rejected"
    page.wait_for_function("before => gruber.parts.status.sigma !== before", arg=before)
    accepted = current(page)
    caught_up(page)
    page.keyboard.press("y")
    becomes(page, accepted, "accepted")
    for key in (accepted, point):
        page.keyboard.press("u")
        becomes(page, key, "auto")
    settled(page)
    assert sigma(page) == pytest.approx(before, abs=1e-4)


def test_what_the_engine_left_out_waits_behind_its_own_button__law(real_desk, sit_at):
    page = sit_at(real_desk.desk.url, scene=False)
    tally = page.evaluate("gruber.parts.queue.counts")
    assert page.evaluate("gruber.parts.queue.shown.length") == tally["open"]
    page.select_option("#sort-column", "doubt")
    shown = "gruber.parts.queue.shown.map(place => gruber.parts.rows[place][5])"
    page.wait_for_function(f"{shown}.every((doubt, n, all) => !n || doubt <= all[n - 1])")
    assert page.evaluate(f"{shown}[0]") > 0
    page.click('.chip[data-state="unused"]')
    page.wait_for_selector('#state-badge:has-text("Unused")')
    assert page.locator("#why .remark").inner_text().startswith("Left out: ")


def test_a_reload_and_another_browser_find_everything__law(real_desk, sit_at):
    page = sit_at(real_desk.desk.url, scene=False)
    point, _, _ = press(page, "n")
    settled(page)
    here, number = current(page), sigma(page)
    page.reload()
    page.wait_for_selector(".row.current")
    assert (current(page), sigma(page)) == (here, number)
    assert state_of(page, point) == "rejected"
    other = sit_at(real_desk.desk.url, scene=False)
    assert sigma(other) == number
    assert state_of(other, point) == "rejected"
    here, _, _ = press(page, "n")
    other.wait_for_function(
        "key => gruber.parts.rows.find(row => `${row[0]}|${row[1]}` === key)[3] === 'rejected'",
        arg=here,
    )


def test_the_mosaic_is_made_again_and_run_finds_the_same__truth(real_desk, sit_at):
    page = sit_at(real_desk.desk.url, scene=False)
    mosaic = real_desk.results / "mosaic.tif"
    before = mosaic.stat().st_mtime_ns
    point = place_wrongly(page)
    page.wait_for_function("gruber.parts.status.stale.length > 0")
    page.click("#remake-start")
    page.wait_for_selector("#making:not([hidden])")
    page.wait_for_selector(REMADE, timeout=REMAKING_MS)
    page.wait_for_function("gruber.parts.status.stale.length === 0")
    wrong = mosaic.stat().st_mtime_ns
    assert wrong > before
    look_at(page, point)
    press(page, "n")
    settled(page)
    page.wait_for_function("gruber.parts.status.stale.length > 0")
    page.click("#remake-start")
    page.wait_for_selector(REMADE, timeout=REMAKING_MS)
    # What tells of the first time may still be there.
    made = "gruber.parts.status.stale.length === 0 && gruber.parts.status.written"
    page.wait_for_function(made, timeout=REMAKING_MS)
    assert mosaic.stat().st_mtime_ns > wrong
    report = json.loads((real_desk.results / "report.json").read_text(encoding="utf-8"))
    assert report["written"]["operator"] == "anna"
    for stage in ("scans", "control", "adjustment"):
        assert report["provenance"][f"digest of {stage}"]
        assert report["timings_s"][stage] > 0
    name, scan = point.split("|")
    with (real_desk.results / "control_points.csv").open(encoding="utf-8") as file:
        rows = {(row["point_id"], row["scan"]): row for row in csv.DictReader(file)}
    assert rows[name, scan]["status"] == "rejected"
    shown = sigma(page)
    silent = JsonLines(io.StringIO())
    walk = run_block(real_desk.folder, silent, RunOptions(last="adjustment"))
    assert round(walk.adjusted.sigma_nought, 4) == shown


def served(folder: Path, port: int) -> tuple[subprocess.Popen, str]:
    """The desk as a process of its own, and its address."""
    command = [sys.executable, "-m", "gruber", "review", str(folder), "--no-browser"]
    process = subprocess.Popen(
        [*command, "--port", str(port), "--operator", "anna"], cwd=REPOSITORY,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    found = re.search(r"http://\S+", process.stdout.readline())
    process.stdout.close()
    assert found is not None
    return process, found.group(0)


def test_a_page_comes_back_to_a_desk_that_was_killed__law(run_folder, sit_at):
    process, url = served(run_folder, 0)
    try:
        page = sit_at(url, scene=False)
        page.select_option("#sort-column", "score")
        page.click('.chip[data-state="all"]')
        point, _, _ = press(page, "n")
        settled(page)
        here, number = current(page), sigma(page)
        process.kill()
        process.wait()
        page.wait_for_selector("#lost:not([hidden])")
        process, again = served(run_folder, int(url.partition("127.0.0.1:")[2].partition("/")[0]))
        assert again == url
        page.wait_for_selector(f".notice >> text={words('en')['notice.reopened']}")
        page.wait_for_selector("#lost", state="hidden")
        page.wait_for_function(
            "key => document.querySelector('.row.current')?.dataset.key === key", arg=here
        )
        assert sigma(page) == number
        assert page.locator('.chip.on[data-state="all"]').count() == 1
        page.click('.chip[data-state="rejected"]')
        becomes(page, point, "rejected")
    finally:
        process.kill()
        process.wait()
