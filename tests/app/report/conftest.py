"""A report that was written, as page and figures."""

import json

import pytest

from app.report.page import write_report


@pytest.fixture(scope="module")
def written(content, tmp_path_factory):
    html, figures = write_report(tmp_path_factory.mktemp("report"), content)
    return html.read_text(encoding="utf-8"), json.loads(figures.read_text(encoding="utf-8"))
