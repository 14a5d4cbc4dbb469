"""Photos are tied to what is nearest in time."""

from dataclasses import replace
from pathlib import Path

from app.references import OtherReference, ReferenceSection


def test_nearest_in_time_comes_first_and_what_has_no_year_is_todays__law(tmp_path: Path) -> None:
    def dated(year: int, ties: bool = True) -> OtherReference:
        return OtherReference((tmp_path / f"{year}.tif",), (), year, 0.5, 0.5, ties)

    own = ReferenceSection((tmp_path / "o.tif",), ortho_sigma_m=0.3, dem_sigma_m=0.4)
    section = replace(own, other=(dated(1998), dated(1953), dated(1940, ties=False)))
    taken = ["1938-05-16", "1938", "1949-07"]
    layers = list(section.layers("EPSG:5514", taken, tmp_path))
    assert [one.name for one in layers] == ["1953.tif (1953)", "1998.tif (1998)", "o.tif"]
    assert [one.ortho_sigma_m for one in layers] == [0.5, 0.5, 0.3]
    later = replace(section, year=1960).layers("EPSG:5514", ["1959"], tmp_path)
    assert next(one.name for one in later) == "o.tif (1960)"
    assert not list(own.layers("EPSG:5514", [], tmp_path))
