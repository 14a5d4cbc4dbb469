"""From an empty folder to the desk, by clicks alone: the program is started as a person does it."""

import shutil
from pathlib import Path

import pytest

from app.batch import LOCK
from app.block_toml import BATCH_TABLE
from app.start import open_start
from sessions.processes import only_run
from tests.browser.conftest import AT_WORK, PATIENCE_MS, VIOLATIONS
from tests.browser.hands import caught_up, drawn, until
from tests.browser.test_desk_security import asked, entered
from tests.journeys.copies import copied, reviewing
from ui.web.access import Door

RUN_MS = 600_000
SCANS = 2
MARKS = "1 -85.589 0.091\n2 85.303 -0.002\n3 0.121 85.589\n4 -0.075 -85.322"


@pytest.fixture
def reviewed(tmp_path):
    """`gruber review` on an empty folder: the folder and the address."""
    folder = tmp_path / "block"
    folder.mkdir()
    with reviewing(folder) as url:
        yield folder, url


@pytest.fixture
def page(chromium, reviewed):
    context = chromium.new_context(viewport={"width": 1366, "height": 768}, bypass_csp=True)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.goto(reviewed[1])
    page.wait_for_selector("#drop")
    yield page
    context.close()


def add(page, kind: str, act: str, *paths: Path) -> None:
    with page.expect_file_chooser() as chooser:
        page.click(f'[data-act="start.add.{act}"]')
    chooser.value.set_files([str(path) for path in paths])
    page.wait_for_function("k => gruber.found()?.found.some(([name]) => name === k)", arg=kind)


def test_from_an_empty_folder_to_the_desk__truth(reviewed, page, tiny_block, tmp_path):
    folder, _ = reviewed
    given = copied(tiny_block, tmp_path / "given", SCANS).folder
    assert page.locator(".needs").count() >= 5
    assert page.is_disabled('[data-act="placing.run"]')
    for kind in ("scans", "ortho", "roads"):
        add(page, kind, "folder", given / kind)
    add(page, "dem", "files", given / "dem.tif")
    assert page.locator(".thumb").count() == SCANS
    distance = "#field-camera-film-principal_distance_mm"
    page.fill(distance, "0.21159")
    page.wait_for_selector(".field.bad .wrong:has-text('looks like metres: write 211.59')")
    assert page.is_disabled('[data-act="placing.run"]')
    page.fill(distance, "211,59")
    page.fill("#field-camera-film-fiducials_mm", MARKS)
    page.wait_for_selector('[data-act="placing.run"]:not(:disabled)')
    page.click('[data-tab="map"]')
    assert page.locator("#map polygon.scan").count() == SCANS
    page.click('[data-act="placing.run"]')
    page.wait_for_selector(".stage.now")
    page.wait_for_selector("#queue .row.current", timeout=RUN_MS)
    assert (folder / "results" / "report.html").is_file()
    page.keyboard.press("Escape")  # the tour of a first visit
    # Back to the settings, of which another browser is told, and to the desk.
    other = page.context.browser.new_context().new_page()
    other.goto(reviewed[1])
    page.wait_for_selector("#people .person")
    page.click("#settings-open")
    page.wait_for_selector(".notice.grave")
    caught_up(page)
    page.click("#settings-open")
    page.wait_for_selector("#go .muted:has-text('Nothing has changed')")
    assert page.is_hidden("#left")
    other.wait_for_selector("#left:has-text('opened the settings'):has-text('Open the desk')")
    page.fill(distance, "211.6")
    page.wait_for_selector("#go .muted:has-text('A run makes again: interior orientation')")
    page.click('[data-act="start.desk"]')
    for one in (page, other):
        one.wait_for_selector("#queue .row.current", timeout=RUN_MS)
    other.context.close()


def test_a_run_is_cancelled_and_the_settings_stay__truth(page, tiny_block):
    for kind in ("scans", "ortho"):
        add(page, kind, "folder", tiny_block / kind)
    add(page, "dem", "files", tiny_block / "dem.tif")
    distance = "#field-camera-film-principal_distance_mm"
    gap = "#holdings .lacks:has-text('the principal distance')"
    page.wait_for_function(DRAWN)
    assert page.evaluate(CORNER) == 0, "nothing is drawn beside a scan"
    page.wait_for_selector(gap)
    page.fill(distance, "some")
    page.wait_for_selector("#mend")
    assert page.query_selector(gap), "what cannot be used fills no gap"
    # A figure that no camera has is told as it is written, and a run asks once more.
    page.fill(distance, "21.159")
    page.wait_for_selector("#go .lacks:has-text('Principal distance')")
    page.wait_for_selector(gap, state="detached")
    page.dblclick('[data-act="placing.run"]:not(:disabled)')  # a habit: the second is no answer
    page.wait_for_selector('[data-act="placing.run"]:has-text("anyway")')
    page.wait_for_timeout(600)
    assert not page.query_selector(".stage")
    page.fill(distance, "211.59")
    page.wait_for_selector("#go .lacks", state="detached")
    page.wait_for_selector('[data-act="placing.run"]:not(:disabled)')
    page.click('[data-act="placing.run"]')
    page.wait_for_selector(".stage.now")
    page.click('[data-act="remake.cancel"]')
    page.wait_for_selector(".stage.stopped")
    assert page.input_value(distance) == "211.59"
    page.wait_for_selector('[data-act="placing.run"]:not(:disabled)')
    # A form drawn anew while a field is marked whole: what is typed takes its place.
    page.evaluate("where => document.querySelector(where).select()", distance)
    page.evaluate("() => gruber.load()")
    page.keyboard.type("212")
    # What is written and not saved outlives the page, until it is discarded.
    page.reload()
    page.wait_for_selector('[data-act="start.discard"]')
    assert page.input_value(distance) == "212"
    page.click('[data-act="start.discard"]')
    page.wait_for_selector('[data-act="start.discard"]', state="detached")
    assert page.input_value(distance) == "211.59"


def test_the_start_page_is_locked_as_the_desk_is__law(reviewed):
    folder, url = reviewed
    root, cookie = entered(url)
    for path in ("/", "/found", "/run"):
        assert asked(root + path)[0] == 401
        assert asked(root + path, cookie)[0] == 200
        assert asked(root + path, cookie, Origin="http://evil.example")[0] == 403
        assert asked(root + path, cookie, Host="evil.example")[0] == 421
    for path in ("/tiles/ortho/0/0/0", "/tiles/raw/x/1/0/0/0", "/results/", "/pages/../start.py"):
        assert asked(root + path, cookie)[0] == 404
    assert [path.name for path in folder.iterdir()] == [".gruber"]


CORNER = """(() => document.querySelector("#film .picture").getContext("2d")
    .getImageData(0, 0, 1, 1).data[3])()"""
DRAWN = """() => { const canvas = document.querySelector("#film .picture");
    const { width, height } = canvas;
    return canvas.getContext("2d").getImageData(width / 2, height / 2, 1, 1).data[3] > 0; }"""
"""Opacity in the corner of the film's pane; and whether its middle is drawn."""
CHECKING = {"en-GB": "Checking", "cs-CZ": "Kontroluje se"}
CUT_NAMES = """() => [...document.querySelectorAll(".thumb b")]
    .filter((name) => name.scrollWidth > name.clientWidth).map((name) => name.textContent)"""


@pytest.mark.parametrize(("language", "theme"), [("en-GB", "dark"), ("cs-CZ", "light")])
def test_axe_finds_nothing_on_the_start_page__oracle(
    chromium, axe, tiny_block, tmp_path, language, theme
):
    """With scans, one of them broken, and a field that is filled in wrongly."""
    for part in ("scans", "ortho"):
        shutil.copytree(tiny_block / part, tmp_path / part)
    (tmp_path / "scans" / "broken.tif").write_bytes(b"II*\0")
    context = chromium.new_context(locale=language, bypass_csp=True)
    context.set_default_timeout(PATIENCE_MS)
    context.add_init_script(f"localStorage.setItem('gruber.theme', '{theme}')")
    with open_start(tmp_path, Door()) as opened:
        page = context.new_page()
        page.goto(opened.url)
        page.wait_for_selector(".thumb.bad")
        # A broken file comes first, and says why; names of the others can be told apart.
        assert "broken.tif" in page.locator("#holdings li").first.inner_text()
        assert "bad" in page.locator(".thumb").first.get_attribute("class")
        page.locator(".thumb").first.click()
        page.wait_for_selector("#margin .doubted:has-text('broken.tif')")
        assert page.evaluate(CUT_NAMES) == []
        page.evaluate(axe)
        page.fill("#field-camera-film-principal_distance_mm", "0.2")
        page.wait_for_selector(".field.bad")
        page.fill("#field-block-crs", "EPSG:99999")
        page.wait_for_selector(f"#go p:has-text('{CHECKING[language]}')")
        page.wait_for_selector("#field-block-crs[aria-invalid=true]")
        assert page.locator(f"#go p:has-text('{CHECKING[language]}')").count() == 0
        page.fill("#field-camera-film-fiducials_mm", "1 -85 0\n2 85 0\n1 0 85")
        page.wait_for_selector("#field-camera-film-fiducials_mm-wrong:has-text('1')")
        found = [page.evaluate(VIOLATIONS)]
        for tab in ("map", "run"):
            page.click(f'[data-tab="{tab}"]')
            found.append(page.evaluate(VIOLATIONS))
        page.click('[data-act="start.link"]')
        page.wait_for_selector("#folders[open]")
        found.append(page.evaluate(VIOLATIONS))
    context.close()
    assert found == [[]] * 4


def test_two_pages_save_what_was_written_in_each__law(chromium, tiny_block, tmp_path):
    """Each wrote back what the other had changed; an error of the look at the folder left both
    without a word."""
    for part in ("scans", "ortho"):
        shutil.copytree(tiny_block / part, tmp_path / part)
    context = chromium.new_context(bypass_csp=True)
    context.set_default_timeout(PATIENCE_MS)
    distance, pixel = "#field-camera-film-principal_distance_mm", "#field-scans-scan_pixel_um"
    saved = ".notice:has-text('Settings saved')"
    with open_start(tmp_path, Door()) as opened:
        one, other = context.new_page(), context.new_page()
        for page in (one, other):
            page.goto(opened.url)
            page.wait_for_selector(distance)
        one.fill(distance, "152.67")
        one.click('[data-act="start.save"]')
        one.wait_for_selector(saved)
        other.fill(pixel, "21")
        other.click('[data-act="start.save"]')
        other.wait_for_selector(saved)
        other.wait_for_function(f"document.querySelector('{distance}').value === '152.67'")
        # What was saved is the file's from now on, not what was once written here.
        one.click('[data-act="start.save"]')
        one.wait_for_function(f"document.querySelector('{pixel}').value === '21'")
        other.fill(distance, "211.59")
        # Only then has it looked at what it saved.
        with other.expect_response("**/found"):
            other.click('[data-act="start.save"]')
        one.click('[data-act="start.save"]')
        one.wait_for_function(f"document.querySelector('{distance}').value === '211.59'")
        # The same field of both: the second is told, and sees what the file has now.
        other.fill(distance, "213")
        one.fill(distance, "212")
        with one.expect_response("**/found"):
            one.click('[data-act="start.save"]')
        other.click('[data-act="start.save"]')
        other.wait_for_selector(".notice.grave:has-text('principal_distance_mm')")
        other.wait_for_selector(f".field:has({distance}) small:has-text('212')")
        assert other.input_value(distance) == "213"
        other.click('[data-act="start.save"]')
        other.wait_for_function("!document.querySelector('[data-act=\"start.discard\"]')")
        told = {"status": 409, "json": {"error": "The list is broken."}}
        one.route("**/found", lambda route: route.fulfill(**told))
        one.reload()
        one.wait_for_selector(".notice.grave:has-text('The list is broken.')")
    context.close()


def test_an_older_look_at_the_folder_is_not_shown_over_a_newer__law(chromium, tiny_block, tmp_path):
    """A slow answer brought back the settings of before they were saved."""
    for part in ("scans", "ortho"):
        shutil.copytree(tiny_block / part, tmp_path / part)
    context = chromium.new_context(bypass_csp=True)
    context.set_default_timeout(PATIENCE_MS)
    distance, held = "#field-camera-film-principal_distance_mm", []
    with open_start(tmp_path, Door()) as opened:
        page = context.new_page()
        page.goto(opened.url)
        page.wait_for_selector(distance)
        page.route("**/found", lambda route: held.append((route, route.fetch())), times=1)
        page.evaluate("() => { gruber.load(); }")
        until(page, lambda: held)
        page.fill(distance, "152.67")
        page.click('[data-act="start.save"]')
        page.wait_for_selector('[data-act="start.discard"]', state="detached")
        (route, old) = held.pop()
        with page.expect_response("**/found"):
            route.fulfill(response=old)
        drawn(page)
        assert page.input_value(distance) == "152.67"
    context.close()


def test_each_upload_is_cancelled_at_its_own_line_and_drops_follow_in_turn__law(page):
    """*Cancel* at a file that waited stopped another, and a second drop ran beside the first."""
    held = []
    page.route("**/files/**", lambda route: held.append(route))
    drop = "names => { gruber.send(names.map(name => [name, new File(['x'], name)])); }"
    page.evaluate(drop, ["a.tif", "b.tif", "c.tif"])
    page.evaluate(drop, ["d.tif"])
    page.click(".upload:has-text('b.tif') button")
    page.wait_for_selector(".upload:has-text('b.tif') .doubted")
    sent = []
    for name in ("a.tif", "c.tif", "d.tif"):
        until(page, lambda: held)
        page.wait_for_timeout(200)
        assert len(held) == 1, "one at a time"
        sent.append(held[0].request.url.rpartition("/")[2])
        if name == "d.tif":
            page.click(".upload:has-text('d.tif') button")
            page.wait_for_selector(".upload:has-text('d.tif') .doubted")
        else:
            held.pop().fulfill(status=200, json={})
            page.wait_for_selector(f".upload:has-text('{name}')", state="detached")
    assert sent == ["a.tif", "c.tif", "d.tif"]
    assert page.locator(".upload .doubted").count() == 2


@pytest.fixture
def started(chromium, tmp_path):
    """The start page of the folder `many`, in a browser of its own."""
    (tmp_path / "many").mkdir()
    context = chromium.new_context(bypass_csp=True)
    context.set_default_timeout(PATIENCE_MS)
    with open_start(tmp_path / "many", Door()) as opened:
        page = context.new_page()
        yield lambda: page.goto(opened.url) and page
    context.close()


def test_a_folder_of_blocks_lacks_nothing_of_a_block__law(started, tiny_block, tmp_path):
    shutil.copytree(tiny_block, tmp_path / "many" / "one")
    page = started()
    page.wait_for_selector("#files .have:has-text('one')")
    assert page.locator("#holdings .lacks, #holdings .needs").count() == 0
    assert "to be filled in" not in page.inner_text("#go")


def test_the_list_of_blocks_follows_a_batch__truth(started, tiny_block, tmp_path):
    for name in ("one", "two"):
        shutil.copytree(tiny_block, tmp_path / "many" / name)
    table = tmp_path / "many" / BATCH_TABLE
    head = "block,state,stage,seconds,findings,message\n"
    table.write_text(f"{head}one,running,ties,0,,\ntwo,waiting,,0,,\n", encoding="utf-8")
    with only_run(tmp_path / "many" / LOCK, "ada", batch=True):
        page = started()
        page.wait_for_selector("#batch:has-text('1 running, 1 waiting')")
        page.wait_for_selector("[data-batch=one]:has-text('tie points between the scans')")
        table.write_text(f"{head}one,running,control,0,,\ntwo,waiting,,0,,\n", encoding="utf-8")
        page.wait_for_selector("[data-batch=one]:has-text('control points and the block')")
    page.wait_for_selector("#batch:has-text('2 not finished')")
    cut = "a.tif: is cut off. Scan it."
    table.write_text(f"{head}one,failed,scans,3,,{cut}\ntwo,done,report,9,0,\n", "utf-8")
    page = started()
    page.wait_for_selector(f"[data-batch=one]:has-text('{cut}')")
    page.wait_for_selector("#batch:has-text('1 failed, 1 done')")
    assert page.inner_text("[data-batch=two]") == ""
    assert BATCH_TABLE not in page.inner_text("#holdings")


def test_what_neighbours_share_is_compared_and_leads_to_the_photo__truth(
    chromium, tiny_run, tmp_path
):
    for name in ("one", "other"):
        shutil.copytree(tiny_run.folder, tmp_path / "many" / name)
    photo = sorted(tiny_run.photos)[2]
    with reviewing(tmp_path / "many") as url:
        context = chromium.new_context(viewport={"width": 1366, "height": 768}, bypass_csp=True)
        context.set_default_timeout(RUN_MS)
        page = context.new_page()
        page.goto(url)
        page.click('[data-tab="neighbours"]')
        page.wait_for_selector("#neighbours tr.agree")
        assert "0 disagree" in page.inner_text("#neighbours")
        # Chosen again, the tab knows what has changed since; what does not open is not sought.
        assert "not adjusted" not in page.inner_text("#neighbours")
        (tmp_path / "many" / "new").mkdir()
        shutil.copy(tiny_run.folder / "block.toml", tmp_path / "many" / "new")
        page.click('[data-tab="film"]')
        page.click('[data-tab="neighbours"]')
        page.wait_for_selector("#neighbours :text('1 block is not adjusted yet: run it.')")
        (tmp_path / "many" / "other").rename(tmp_path / "many" / "away")
        page.click(f"#neighbours tr.agree:has-text('{photo}') button:has-text('other')")
        page.wait_for_selector(".notice.grave:has-text('is no folder')")
        page.wait_for_function("() => !sessionStorage.getItem('gruber.sought')")
        (tmp_path / "many" / "away").rename(tmp_path / "many" / "other")
        row = page.locator(f"#neighbours tr.agree:has-text('{photo}')")
        assert row.locator(".value").all_inner_texts()[0] == "0.00"
        row.locator("button:has-text('other')").click()
        page.wait_for_selector("#queue .row.current")
        page.wait_for_function("p => window.gruber?.parts.point?.key[1] === p", arg=photo)
        assert page.inner_text("#name") != "many"
        context.close()


LASTING = """() => {
  const later = window.setTimeout;
  window.setTimeout = (act, ms) => (ms < 3000 ? later(act, ms) : 0);
}"""
"""Notices stay: what takes one away is not time."""


def test_what_holds_a_run_back_is_named_at_the_foot_until_it_is_mended__truth(
    chromium, tiny_block, tmp_path
):
    """*Run* was grey without a word, and the refusal stayed beside "Settings saved."."""
    folder, home, held = tmp_path / "many" / "one", tmp_path / "many", []
    shutil.copytree(tiny_block / "scans", folder / "scans")
    shutil.copytree(tiny_block / "ortho", folder / "ortho")
    context = chromium.new_context(viewport={"width": 1366, "height": 768}, bypass_csp=True)
    context.set_default_timeout(PATIENCE_MS)
    with open_start(folder, Door(), home=home) as opened:
        page = context.new_page()
        page.goto(opened.url)
        page.fill("#field-scans-scan_pixel_um", "abc")
        page.click('[data-to="scans.scan_pixel_um"]')
        assert page.evaluate("document.activeElement.id") == "field-scans-scan_pixel_um"
        page.click('[data-act="start.save"]')
        page.wait_for_selector(".notice.grave")
        page.fill("#field-scans-scan_pixel_um", "180")
        page.wait_for_selector(".notice.grave", state="detached")
        page.wait_for_selector("#mend", state="detached")
        page.fill("#field-scans-scan_pixel_um", "abc")
        page.click('[data-act="start.save"]')
        page.wait_for_selector(".notice.grave")
        # Saved before the page has been told that it is mended: that leaves the newer notice.
        page.evaluate(LASTING)
        page.route("**/form/judge", lambda route: held.append(route))
        page.fill("#field-scans-scan_pixel_um", "180")
        until(page, lambda: held)
        page.click('[data-act="start.save"]')
        page.wait_for_selector(".notice:has-text('Settings saved')")
        with page.expect_response("**/form/judge"):
            held.pop().continue_()
        page.wait_for_selector("#go .muted:has-text('Checking')", state="detached")
        assert page.locator(".notice").all_inner_texts() == ["Settings saved."]
        page.click('[data-act="start.home"]')
        assert opened.wait() == home
    context.close()


def test_who_leaves_a_run_is_asked_first__law(chromium, tiny_block, tmp_path):
    """It was cancelled at once, without a word."""
    shutil.copytree(tiny_block, tmp_path / "many" / "one")
    context = chromium.new_context(bypass_csp=True)
    context.set_default_timeout(PATIENCE_MS)
    with open_start(tmp_path / "many", Door()) as opened:
        page, opening = context.new_page(), []
        page.route("**/run", lambda route: route.fulfill(json=AT_WORK))
        page.route("**/open", lambda route: opening.append(1) or route.fulfill(json={}))
        page.goto(opened.url)
        block = "#files .have button:has-text('one')"
        page.click(block)
        page.wait_for_selector(".notice.grave:has-text('stops the run')")
        assert not opening
        with page.expect_request("**/open"):
            page.click(block)
    context.close()
