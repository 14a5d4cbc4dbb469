"""The accuracy report: what it says, that it says all of it, and that it needs no network."""

import base64
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import rasterio
from affine import Affine
from PIL import Image

from app.report.model import ReportContent
from app.report.page import CHAPTERS, render, requirements, under, write_report
from app.report.plots import draw_film, draw_histogram, draw_trend, longest_mean
from app.report.wording import fine, parameter_told
from core.adjustment.adjusted import Contradiction, SharedParameter
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.block import REFERENCE, TiePoints
from core.matching.reference import ReferenceLayer
from core.mosaic.comparison import ComparedPlaces, MosaicAccuracy
from core.mosaic.fault_places import FaultPlace
from core.quality.job_rules import USUAL_RULES
from core.quality.rules import doubts_of
from core.raster.ortho import open_ortho
from ui.review.scene import short_names
from ui.words.catalogue import LANGUAGES, Teller, messages, words

TELL = Teller()


class Texts(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.open, self.text, self.urls = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.urls += [v for k, v in attrs if k in ("src", "href") and v]
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.text.append(data)


def parsed(page):
    parser = Texts()
    parser.feed(page)
    assert not parser.open
    return parser


def text_of(page):
    return re.sub(r"\s+", " ", " ".join(parsed(page).text))


def test_page_is_well_formed_and_needs_no_network__law(written):
    parser = parsed(written[0])
    assert "script" not in parser.tags
    assert "link" not in parser.tags
    assert all(url.startswith(("data:", "#")) for url in parser.urls)
    assert re.findall(r"url\(([^#].{5})", written[0]) == ['"data:'] * 3
    assert "@import" not in written[0]


def test_page_is_a_function_of_the_json__law(written):
    page, figures = written
    picture = re.search(r'href="(data:image/jpeg;base64,[^"]+)"', page).group(1)
    assert render(figures, picture) == page


def test_names_are_text_and_nothing_else__truth(written):
    """Names of points are the surveyor's: none becomes an element of the page."""
    page, figures = written
    hostile = '<script>alert("1")</script>'
    text = json.dumps(figures)
    point = figures["checks"]["points"][0]["point_id"]
    named = json.loads(text.replace(json.dumps(point), json.dumps(hostile)))
    picture = re.search(r'href="(data:image/jpeg;base64,[^"]+)"', page).group(1)
    parser = parsed(render(named, picture))
    assert "script" not in parser.tags
    assert hostile in "".join(parser.text)


def test_every_decision_is_told_with_who_made_it_and_whether_it_stands__law(written):
    page, figures = written
    third, second, first = figures["decisions"]["log"]
    assert [one["stands"] for one in (first, second, third)] == [True, True, False]
    text = text_of(page)
    back = "withdrawn by anna, 2025-11-20 10:03"
    assert f"3 2025-11-20 10:02 anna accepted {third['about']} accepted {back}" in text
    assert f"2 2025-11-20 10:01 anna rejected {second['about']} rejected: changed" in text
    assert len(first["about"].split()) == 2


def test_the_ortho_beneath_shows_the_ground_of_the_mosaic__truth(tmp_path, mosaic):
    """Of an ortho that is red in the west and blue in the east, twice as wide as the mosaic."""
    with rasterio.open(mosaic) as file:
        west, south, east, north = file.bounds
    colours = np.zeros((3, 100, 400), np.uint8)
    colours[0, :, :150], colours[2, :, 150:] = 255, 255
    cell = (east - west) / 200
    placed = Affine(cell, 0, west - 100 * cell, 0, (south - north) / 100, north)
    profile = {"count": 3, "width": 400, "height": 100, "dtype": "uint8", "crs": "EPSG:5514"}
    path = tmp_path / "ortho.tif"
    with rasterio.open(path, "w", driver="GTiff", transform=placed, **profile) as file:
        file.write(colours)
    text = under(mosaic, open_ortho([path], "EPSG:5514"))
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(text.partition(",")[2]))))
    rows, columns, _ = picture.shape
    assert columns / rows == pytest.approx((east - west) / (north - south), rel=0.01)
    red, blue = picture[rows // 2, columns // 5], picture[rows // 2, columns // 3]
    assert (red[0] > 200, red[2] < 50, blue[0] < 50, blue[2] > 200) == (True,) * 4


def test_likely_faults_stand_in_the_order_of_the_desk__law(content, tmp_path):
    """In the order of the list, with what tells them, photo or seam, and P."""
    east, north = content.report.block.origin[:2]
    first, second = list(content.report.block.photos)[:2]
    rows = (
        ("reference", (first,), 9.0, False, 0.4), ("ties", (first, second), 2.0, True, 0.99),
        ("seam", (first, second), 3.0, True, 0.97), ("reference", (second,), 1.0, False, 0.1),
    )  # fmt: skip
    places = [
        FaultPlace(kind, east, north, names, (length, 0.0), 0.3, (0.3, 0.4), sure, 0.0, chance)
        for kind, names, length, sure, chance in rows
    ]
    html, told = write_report(tmp_path, replace(content, likely_faults=places))
    figures = json.loads(told.read_text(encoding="utf-8"))["likely_faults"]
    assert [one["kind"] for one in figures] == ["reference", "ties", "seam", "reference"]
    assert [one["probability"] for one in figures] == [0.4, 0.99, 0.97, 0.1]
    short = short_names(list(content.report.block.photos))
    page = html.read_text(encoding="utf-8")
    table = page[page.index('id="likely"') :].partition("</table>")[0]
    assert f"{short[first]} | {short[second]}" in re.sub(r"\s+", " ", table)
    lines = [TELL(f"mosaic.misfit.{kind}") for kind in ("reference", "ties", "seam")]
    assert [table.index(line) for line in lines] == sorted(table.index(line) for line in lines)


def test_neighbours_along_seams_and_strips_are_told__law(written):
    page, figures = written
    text = text_of(page)
    (first, second), (_, third) = (one["photo_ids"] for one in figures["mosaic"]["neighbours"])
    short = short_names([row["scan"] for row in figures["exterior"]])
    assert f"{short[first]}, {short[second]} 812 31 +2.4 7.5 29 +0.41 −0.12 0.90" in text
    assert f"{short[second]}, {short[third]} 40 0 – – 0 – – –" in text
    strips = figures["residuals"]["strips"]
    assert sorted(scan for one in strips for scan in one["scans"]) == sorted(
        row["scan"] for row in figures["exterior"] if row["oriented"]
    )
    rays = sum(figures["residuals"]["histograms"][name]["count"] for name in ("tie", "control"))
    assert 2 * sum(one["tie_rays"] + one["control"] for one in strips) == rays


def test_text_of_the_data_is_escaped__law(written):
    page, figures = written
    assert figures["block"]["name"] == "kobyli-1938 <script>"
    assert "kobyli-1938 &lt;script&gt;" in page
    assert "<b>rejected</b>" not in page


def test_residuals_are_drawn_by_size_by_place_and_by_photo_with_what_correlates__law(written):
    page, figures = written
    residuals, text = figures["residuals"], text_of(page)
    assert residuals["histograms"]
    assert residuals["trends"]
    assert set(residuals["trends"]) == {"radius", "height"}
    assert list(residuals["films"]) == [row["scan"] for row in figures["exterior"]]
    longest = longest_mean(residuals["films"])
    for film in residuals["films"].values():
        assert f'<figure class="film">{draw_film(film, longest, TELL)}' in page
    for kind, bars in residuals["histograms"].items():
        assert re.sub(r"\s", " ", TELL(f"report.histogram.{kind}", **bars)) in text
        assert draw_histogram(bars, TELL) in page
    for kind, unit in (("radius", "mm"), ("height", "m")):
        assert TELL(f"report.trend.{kind}") in text
        assert draw_trend(residuals["trends"][kind], unit, TELL) in page
    for name in ("report.strips", "head.ground-pixel", "head.correlation"):
        assert TELL(name) in text
    for row in figures["exterior"]:
        assert f"{row['angles_deg'][2]:.4f} {row['ground_pixel_m']:.2f} ".lstrip("-") in text
    pairs = [one for one in figures["parameters"] if one["partner"]]
    assert pairs
    for one in pairs[:20]:
        assert f"{abs(one['correlation']):.2f} {parameter_told(one['partner'], TELL)} " in text


def test_headings_say_the_finding__truth(written):
    page, figures = written
    text = text_of(page)
    assert "6 of 6 photos oriented" in text
    assert "3 doubts are open, the gravest about junction 118" in text
    assert f"in plan: m_p = {figures['checks']['m_p']:.2f} m, too few to judge" in text
    assert "residuals are as large as the a-priori standard deviations say" in text
    assert "One scan was set aside" in text
    assert "The file ends after 3 of 9 MB" in text
    assert "independent check points: 12, fewer than 30, not sufficient for a statement" in text
    assert f"RMSE_H = {figures['checks']['rmse_plan_m']:.2f} m" in text
    assert text.index("junction 118") < text.index("Fiducial 3") < text.index("The DEM has a gap")


def test_every_chapter_has_a_name_of_its_own_and_stands_in_the_contents__law(written):
    """Two chapters were called Control, and there were no contents."""
    page = written[0]
    names = re.findall(r'<h2 id="([^"]+)"><small>', page)
    assert len(names) == len(set(names)) > 12
    assert re.findall(r'<li><a href="#([^"]+)"', page) == names
    for language in LANGUAGES:
        told = [words(language)[f"report.chapter.{name}"] for name in CHAPTERS]
        assert len(told) == len(set(told))


def test_the_first_page_has_every_requirement_who_and_when__truth(written):
    page, figures = written
    front = page[page.index('<section class="front">') : page.index("</section>")]
    for row in requirements(figures, TELL):
        assert row["name"] in front
        assert row["limit"].replace(">", "&gt;") in front
    assert front.count('class="t result') == len(requirements(figures, TELL)) >= 10
    assert all(f'href="#{name}"' in front for name in ("blockmap", "mosaicmap"))
    assert "Signature" in front
    assert "Decisions: 2, by anna, 2025-11-20 10:00 to 2025-11-20 10:01 UTC; taken back: 1" in front
    assert "Written 2025-11-21 01:02 UTC by anna with Gruber 0.1.0." in text_of(page)


def test_the_first_page_says_the_verdict_above_the_table_as_its_chapter_does__law(written):
    page, figures = written
    front = page[page.index('<section class="front">') : page.index('<table class="wanted">')]
    verdict = re.search(r"<h2 id=\"verdict\"><small>[^<]*</small>([^<]+)</h2>", page)[1]
    assert f"<b>{verdict}</b>" in front
    for grave in range(3):
        told = {**figures, "verdict": [{**figures["verdict"][0], "grave": grave}]}
        assert TELL(f"report.verdict.{grave}", count=1) in render(told).split("<table")[0]


def test_what_stands_in_the_table_is_what_the_verdict_says__law(written):
    figures = written[1]
    doubtful = {row["name"] for row in requirements(figures, TELL) if row["grave"]}
    told = {one["kind"]: one["grave"] for one in figures["verdict"]}
    of_checks = {grave for kind, grave in told.items() if "check" in kind and "against" not in kind}
    assert ("Independent check points" in doubtful) == bool(max(of_checks))
    assert ("Tilt" in doubtful) == ("tilt-over" in told)
    assert "Holes inside the mosaic" in doubtful


def test_the_table_tells_places_off_the_reference__truth(written):
    figures = written[1]
    off = {"rule": "misfit", "grave": 1, "kind": "misfit-places", "more": 0, "source": "gruber",
           "values": {"count": "2", "metres": "5.0"}}  # fmt: skip
    told = {**figures["checked"], "rules": [*figures["checked"]["rules"], off]}
    rows = requirements({**figures, "checked": told}, TELL)
    (row,) = (row for row in rows if "off the reference" in row["name"])
    assert (row["value"], row["grave"]) == ("2, by up to 5.0 m", 1)


@pytest.mark.parametrize(
    ("count", "told"),
    [
        (1, "One independent check point, {m_p} m off: too few to judge"),
        (2, "2 independent check points, m_p {m_p} m: too"),
    ],
)
def test_few_check_points_are_not_judged__truth(content, tmp_path, count, told):
    """One point gave 'no systematic shift', and '1 check points'."""
    few = replace(content, report=replace(content.report, checks=content.report.checks[:count]))
    html, figures = write_report(tmp_path, few)
    text = text_of(html.read_text(encoding="utf-8"))
    m_p = json.loads(figures.read_text(encoding="utf-8"))["checks"]["m_p"]
    assert told.format(m_p=f"{m_p:.2f}") in text
    assert "systematic shift" not in text
    assert "1 independent check points" not in text


def test_proposals_kept_out_are_told_apart__truth(content, tmp_path):
    """A user turned proposals into check points and took them for independent ones."""
    report = content.report
    names = [check.point_id for check in report.checks[:5]]
    turned = {
        name: replace(report.block.surveyed[name], source="salient", role="check") for name in names
    }
    block = replace(report.block, surveyed={**report.block.surveyed, **turned})
    html, figures = write_report(tmp_path, replace(content, report=replace(report, block=block)))
    told = json.loads(figures.read_text(encoding="utf-8"))["checks"]
    assert told["count"] == len(report.checks) - 5
    assert [one["point_id"] for one in told["kept_out"]["points"]] == names
    assert "Proposals kept out: 5, RMSE" in text_of(html.read_text(encoding="utf-8"))


def test_references_are_told_with_how_far_each_lies_off__truth(content, tmp_path):
    names = ("shift_E_m", "shift_N_m", "slope_E_east_m")
    off = [
        SharedParameter("../1984 (1984)", name, value, 0.05, 6.2, 0.1, "x0_mm")
        for name, value in zip(names, (0.31, -0.12, 0.4), strict=True)
    ]
    report = replace(content.report, parameters=(*content.report.parameters, *off))
    layers = {
        ReferenceLayer("../1984 (1984)", (tmp_path / "m.tif",), (), 0.4, 0.5): 61,
        ReferenceLayer("ortho", (tmp_path / "o.tif",), (), 0.25, 0.5, datum=True): 40,
    }
    html, figures = write_report(tmp_path, replace(content, report=report, tied_to=layers))
    mosaic, today = json.loads(figures.read_text(encoding="utf-8"))["control"]["references"]
    assert mosaic["shift"] == {"E": 0.31, "N": -0.12, "sigma_E": 0.05, "sigma_N": 0.05}
    assert not today["shift"]
    text = text_of(html.read_text(encoding="utf-8"))
    assert "its points lies +0.31 ± 0.05 m to the east and −0.12" in text
    assert text.count("Seen from these photos") == 1
    assert "its growth to the eastern edge E, m" in text


def test_what_the_reference_is_off_surveyed_points_is_told__truth(content, tmp_path):
    values = {"shift_E_m": 0.2, "shift_N_m": -0.34}
    off = [SharedParameter(REFERENCE, n, v, 0.13, 1.5, 0.1, "x0_mm") for n, v in values.items()]
    report = replace(content.report, parameters=(*content.report.parameters, *off))
    html, _ = write_report(tmp_path, replace(content, report=report))
    told = "on the reference lies +0.20 ± 0.13 m to the east and −0.34 ± 0.13 m to the north"
    assert told in text_of(html.read_text(encoding="utf-8"))
    html, _ = write_report(tmp_path, content)
    assert "on the reference lies" not in text_of(html.read_text(encoding="utf-8"))


def test_control_in_use_is_told_worst_first_and_the_rest_is_counted__truth(content, tmp_path):
    """Three hundred rows of left-out measurements, and none of those in use."""
    told = replace(content, influence=influence_of(content.report, content.adjustment))
    html, figures = write_report(tmp_path, told)
    control = json.loads(figures.read_text(encoding="utf-8"))["control"]
    tests = [row["test"] for row in control["in_use"]]
    assert len(tests) == len(content.report.redundancy_numbers)
    assert tests == sorted(tests, reverse=True)
    page = html.read_text(encoding="utf-8")
    shown = [(row["point_id"], row["scan"]) for row in control["in_use"][:40]]
    chapter = page[page.index('<h2 id="control">') : page.index('<h2 id="distribution">')]
    assert re.findall(r'<td class="t">([^<]+)</td><td class="t" title="([^"]+)">', chapter) == shown
    # Of those left out, no row.
    assert chapter.count("<tr>") == 1 + len(shown)
    text = text_of(page)
    assert f"worst first: {min(len(tests), 40)} of {len(tests)}" in text
    assert f"Measurements left out: {len(control['left_out'])} (" in text


def test_holes_of_the_mosaic_are_named__truth(written):
    text = text_of(written[0])
    assert "2 holes inside the mosaic, 1 300 m² together" in text
    for hole in written[1]["mosaic"]["holes"]:
        row = (TELL.number(hole[name], ",.0f") for name in ("area_m2", "east", "north"))
        assert re.sub(r"\s", " ", " ".join(row)) in text
    assert "Holes inside the mosaic: 2, 1 300 m² together; the largest (900 m²)" in text


def test_small_residuals_are_not_told_as_nought__truth(written):
    """Fiducials that fit to 0.3 um were told as 0 um."""
    figures = json.loads(json.dumps(written[1]))
    for row in figures["interior"]:
        row["rms_um"] *= 0.03
        row["residuals_um"] = {
            name: [0.03 * v for v in both] for name, both in row["residuals_um"].items()
        }
    text = text_of(render(figures))
    assert re.search(r"Fiducials fit to 0\.[1-9]\d µm, the worst scan \(\S+\) to 0\.[1-9]", text)
    table = text[text.index("residuals of fiducials") :][:900]
    assert not re.search(r"[+−]0(?:\.0+)?[,\s]", table)
    assert fine(0.001, TELL, 2) == "<\u202f0.01"
    assert fine(0.0, TELL, 2) == "0.00"


def test_a_blunder_accepted_by_hand_is_named_where_the_block_is_certified__truth(
    content, flown, tmp_path
):
    keys = [k for k in sorted(flown.measurements) if flown.surveyed[k[0]].role == "control"]
    item = flown.measurements[keys[5]]
    wrong = replace(item, column=item.column + 40, sigma_px=0.5, status="accepted", reason="")
    report = adjust_block(flown.with_measurement(wrong))
    told = replace(content, report=report, influence=influence_of(report, content.adjustment))
    html, figures = write_report(tmp_path, told)
    text = text_of(html.read_text(encoding="utf-8"))
    worst = report.contradictions[0]
    assert worst.key == keys[5]
    line = f"{worst.metres:.1f} m ({worst.pixels:.1f} px) away"
    # In the certificate, in the verdict that the desk shows too, and among the doubts.
    assert text.count(line) == 3
    verdict = json.loads(figures.read_text(encoding="utf-8"))["verdict"]
    assert verdict[0]["kind"].startswith("contradicted")


def test_the_chapter_of_doubts_names_all_that_the_filter_of_disputed_points_shows__law(
    content, flown, tmp_path
):
    """More than the verdict names one by one."""
    report = content.report
    keys = [key for key in sorted(flown.measurements) if flown.surveyed[key[0]].role == "control"]
    many = tuple(Contradiction(*key, 9.0, 4.5 + n, 6.0 + n, 0.1) for n, key in enumerate(keys[:14]))
    told = replace(content, report=replace(report, contradictions=many))
    html, figures = write_report(tmp_path, told)
    doubts = json.loads(figures.read_text(encoding="utf-8"))["doubts"]
    named = {(one["subject"], one["evidence"].get("photo")) for one in doubts}
    assert {one.key for one in many} <= named
    text = text_of(html.read_text(encoding="utf-8"))
    chapter = text[text.index("doubts are open") :]
    assert all(f"{one.metres:.1f} m (9.0 px) away" in chapter for one in many)
    assert f"{many[0].metres:.1f} m: {many[0].point_id} (13 more findings)" in text


def test_few_and_many_check_points_have_one_limit_in_the_whole_report__law(content, tmp_path):
    """The table asked for three, the certificate for thirty."""
    few = replace(content, report=replace(content.report, checks=content.report.checks[:5]))
    html, figures = write_report(tmp_path, few)
    told = json.loads(figures.read_text(encoding="utf-8"))
    row = next(r for r in requirements(told, TELL) if r["name"] == "Independent check points")
    assert row["limit"] == f"at least {USUAL_RULES.check_points}"
    assert row["grave"] == 1
    assert not told["checks"]["enough"]
    assert "5 independent check points, m_p" in text_of(html.read_text(encoding="utf-8"))


def test_what_lies_outside_a_histogram_is_counted_and_told__truth(content, tmp_path):
    residuals = np.array(content.report.tie_residuals_px)
    good = np.flatnonzero(np.isfinite(residuals).all(axis=1))
    residuals[good[:3], 0] = 40.0
    wild = replace(content, report=replace(content.report, tie_residuals_px=residuals))
    html, figures = write_report(tmp_path, wild)
    bars = json.loads(figures.read_text(encoding="utf-8"))["residuals"]["histograms"]["tie"]
    assert bars["beyond"] >= 3
    assert sum(bars["counts"]) + bars["beyond"] == bars["count"]
    told = f"{bars['beyond']} values lie beyond ±{bars['reach_px']:,.3g} px, the largest 40 px."
    assert told in text_of(html.read_text(encoding="utf-8"))


def test_without_check_points_accuracy_is_relative__law(content, tmp_path):
    bare = replace(content, report=replace(content.report, checks=()), mosaic=None, seams=())
    html, _ = write_report(tmp_path, bare)
    text = text_of(html.read_text(encoding="utf-8"))
    assert "There are no independent check points" in text
    assert "(sigma 0.25 m, DEM 0.5 m)" in text
    assert "No independent check points: accuracy is relative to the reference ortho" in text


def test_barest_block_still_makes_a_report__law(content, tmp_path):
    block = replace(content.report.block, surveyed={}, measurements={}, ties=TiePoints.none())
    report = replace(
        content.report,
        block=block,
        exterior_sigmas={},
        residuals_px={},
        surveyed_positions={},
        surveyed_sigmas_m={},
        redundancy_numbers={},
        tie_positions=np.zeros((0, 3)),
        tie_sigmas_m=np.zeros((0, 3)),
        tie_residuals_px=np.zeros((0, 2)),
        checks=(),
        rms_px={},
        rms_m={},
        rejected={},
        sigma_nought=float("nan"),
        redundancy=0,
        converged=False,
    )
    html, figures = write_report(tmp_path, ReportContent("bare", report))
    text = text_of(html.read_text(encoding="utf-8"))
    assert "The adjustment did not settle" in text
    assert "No control steers the block" in text
    assert "No tie points" in text
    told = json.loads(figures.read_text(encoding="utf-8"))
    assert told["adjustment"]["sigma_nought"] is None


def a_comparison():
    verdicts = ("used", "used", "low")
    places = ComparedPlaces(np.zeros((3, 2)), np.full((3, 2), 0.1), np.ones(3), verdicts)
    return MosaicAccuracy(
        n=2,
        m_x=0.1,
        m_y=0.1,
        m_p=0.1414,
        m_p_interval=(0.1, 0.3),
        mean_shift=(0.1, 0.1),
        deviation=(0.0, float("nan")),
        median_shift=(0.1, 0.1),
        nmad=(0.0, 0.0),
        largest=0.14,
        m_p_with_mismatches=0.15,
        refused={"low": 1},
        ground_sample_distance_m=0.5,
        places=places,
    )


def test_comparison_with_truth_is_told__law(content, tmp_path):
    html, figures = write_report(tmp_path, replace(content, comparisons={"truth": a_comparison()}))
    text = text_of(html.read_text(encoding="utf-8"))
    assert "Against truth: m_p 0.14 m at 2 places" in text
    told = json.loads(figures.read_text(encoding="utf-8"))
    assert len(told["comparisons"][0]["vectors"]) == 2


def test_it_says_where_more_control_would_help__law(content, tmp_path):
    ahead = influence_of(content.report, content.adjustment)
    html, figures = write_report(tmp_path, replace(content, influence=ahead))
    wanted = json.loads(figures.read_text(encoding="utf-8"))["control_spread"]["wanted"]
    told = text_of(html.read_text(encoding="utf-8"))
    assert wanted[0]["worst_then_m"] < 10
    assert ("This block is not released" in told) != ("a block is released" in told)
    assert "fewer than 30" in told
    assert "The block is certified" not in told
    assert "Where one more control point would help most" in told
    assert f"{wanted[0]['sigma_then_m']:.2f}" in told


def english_pieces():
    """Stretches of the English catalogue that are longer than two words and not Czech as well."""
    czech = " ".join(words("cs").values())
    for text in (*words().values(), *messages("cs")):
        for piece in re.split(r"\{[^{}]*\}", text):
            if len(piece.split()) > 2 and piece.strip() not in czech:
                yield piece.strip()


def test_a_czech_report_holds_no_english_sentence__law(content, tmp_path):
    told = replace(
        content,
        doubts=doubts_of(content.report),
        influence=influence_of(content.report, content.adjustment),
        comparisons={"truth": a_comparison()},
    )
    text = text_of(
        write_report(tmp_path, replace(told, language="cs"))[0].read_text(encoding="utf-8")
    )
    english = text_of(write_report(tmp_path, told)[0].read_text(encoding="utf-8"))
    assert sum(piece in english for piece in english_pieces()) > 60
    assert [piece for piece in english_pieces() if piece in text] == []
    assert "Jednotková směrodatná odchylka" in text
    assert "Otisk kroku: vnitřní orientace skenů" in text
    assert not re.search(r"\d{4}-\d\d-\d\d", text), "a time as a computer has it"
    assert not re.search(r"_(mm|um|deg)\b", text), "a parameter as a program calls it"
    # A figure has a comma; names of files and coordinates of nought keep what they are.
    assert not re.search(r"\d\.\d+ (?:m|px|µm)\b", text)
    assert not re.search(r"[.,]\d{7}", text), "a figure as a computer has it"


def test_figures_for_programs_are_the_same_in_every_language__law(content, tmp_path):
    both = [replace(content, language=language) for language in LANGUAGES]
    told = [write_report(tmp_path, one)[1].read_bytes() for one in both]
    assert told[0] == told[1]
