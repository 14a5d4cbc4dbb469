"""How exactly a click places a point: dots of known place, eight screen pixels for one."""

from dataclasses import replace

import numpy as np

from app.desk.wiring import open_desk
from sessions.session import Session
from tests.browser.hands import accept, gone_on
from tests.ui.desk_block import desk_inputs

STEP, OFFSET, ZOOM = 16, np.array([0.37, 0.61]), 8.0
CENTROID = """([x, y]) => {
  const canvas = document.querySelector('.pane[data-pane=right] .picture');
  const ratio = window.devicePixelRatio, half = Math.round(40 * ratio);
  const [left, top] = [Math.round(x * ratio) - half, Math.round(y * ratio) - half];
  const { data } = canvas.getContext('2d').getImageData(left, top, 2 * half, 2 * half);
  let [sum, across, down] = [0, 0, 0];
  for (let j = 0; j < 2 * half; j += 1) for (let i = 0; i < 2 * half; i += 1) {
    const weight = Math.max(data[4 * (j * 2 * half + i)] - 90, 0);
    sum += weight; across += weight * (i + 0.5); down += weight * (j + 0.5);
  }
  return [(left + across / sum) / ratio, (top + down / sum) / ratio];
}"""

SCALE = """() => { const s = gruber.compareState(); const [[a, b], [c, d]] = s.point.raw.matrix;
  return s.view.scale / Math.sqrt(Math.abs(a * d - b * c)); }"""
MIDDLE = """() => {
  const { point: { raw, marks }, view } = gruber.compareState();
  const [[a, b], [c, d]] = raw.matrix;
  const [e, n] = [view.east - marks.predicted[0], view.north - marks.predicted[1]];
  return [raw.predicted[0] + a * e + b * n, raw.predicted[1] + c * e + d * n];
}"""


def dotted(scan, column, row, columns, rows, reduction):
    """A scan of round dots, every sixteen pixels, beside the middle of a pixel."""
    across = column + (np.arange(columns // reduction) + 0.5) * reduction
    down = row + (np.arange(rows // reduction) + 0.5) * reduction
    beside, below = (
        (values - offset + STEP / 2) % STEP - STEP / 2
        for values, offset in zip((across, down), OFFSET, strict=True)
    )
    squares = below[:, None] ** 2 + beside[None, :] ** 2
    return (20 + 230 * np.exp(-squares / 8)).astype(np.float32)


def test_clicks_on_dots_place_within_a_tenth_of_a_pixel__truth(tmp_path, sit_at, monkeypatch):
    inputs = replace(desk_inputs(tmp_path), read_scan=dotted)
    errors = []
    with open_desk(inputs) as desk:
        monkeypatch.setattr(desk.loop, "_adjust", lambda: None)
        page = sit_at(desk.url, scene=False)
        page.keyboard.press("r")
        for _ in range(12):
            if page.evaluate(SCALE) > ZOOM:
                break
            page.keyboard.press("+")
        for _ in range(6):
            errors.append(placed_error(page))
            before = page.get_attribute(".row.current", "data-key")
            accept(page)
            gone_on(page, before)
        settled_count = page.evaluate("gruber.parts.status.decided")
    with Session.open(tmp_path, "reader") as session:
        assert len(session.decisions()) == settled_count == len(errors)
    inputs.session.close()
    assert max(errors) < 0.1, errors


def placed_error(page) -> float:
    """Click the dot nearest to the middle; pixels between what is recorded and the dot."""
    page.wait_for_function(
        "() => { const { drawn, point } = gruber.compareState();"
        " return drawn.whole && drawn.key === point.key.join('|'); }"
    )
    pane = page.locator('.pane[data-pane="right"]')
    box = pane.bounding_box()
    size = pane.evaluate("pane => [pane.clientWidth, pane.clientHeight]")
    scale, middle = page.evaluate(SCALE), np.array(page.evaluate(MIDDLE))
    dot = np.rint((middle + 4 - OFFSET) / STEP) * STEP + OFFSET
    near = (dot - middle) * scale + np.array(size) / 2
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    seen = np.array(page.evaluate(CENTROID, near.tolist()))
    page.mouse.click(*np.rint(seen + np.array([box["x"], box["y"]])))
    page.wait_for_function("gruber.parts.point.draft")
    settled_place = page.evaluate("gruber.parts.point.draft.raw")
    return float(np.hypot(*(np.array(settled_place) - dot)))
