"""Whether a block can be worked in a CRS: projected, metres, X east and Y north."""

from pyproj import CRS
from pyproj.exceptions import CRSError

ADVICE = {
    "EPSG:5513": "Use EPSG:5514, the same map with X east and Y north, both negative.",
    "EPSG:2065": "Use EPSG:5514, S-JTSK from Greenwich with X east and Y north, both negative.",
}
"""What to use in place of a CRS that is often named by mistake."""
_PROJECTED = "Name the projected CRS of the ortho and the DEM, such as EPSG:5514 or EPSG:32633."


def objection_to_crs(text: str) -> tuple[str, str] | None:
    """Cause and remedy why a block cannot be worked in a CRS; None when it can."""
    try:
        crs = CRS(text)
    except CRSError:
        return f'"{text}" is no coordinate reference system.', _PROJECTED
    if crs.is_compound:
        parts = [_code(part) for part in crs.sub_crs_list]
        advice = f'Write crs = "{parts[0]}" and heights = "{parts[-1]}".'
        return f'"{text}" holds heights too; this is for the map alone.', advice
    if not crs.is_projected:
        kind = "geographic (degrees)" if crs.is_geographic else "not a map projection"
        return f'"{text}" is {kind}.', _PROJECTED
    return _objection_to_axes(text, crs)


def objection_to_heights(text: str) -> tuple[str, str] | None:
    """Cause and remedy why words cannot name the heights; any words will do but a wrong code."""
    if ":" not in text or not text.upper().startswith("EPSG"):
        return None
    try:
        vertical = CRS(text).is_vertical
    except CRSError:
        vertical = False
    if vertical:
        return None
    return f'"{text}" is no height system.', 'Name one, such as "EPSG:8357", or write words: "Bpv".'


def _objection_to_axes(text: str, crs: CRS) -> tuple[str, str] | None:
    directions = {axis.direction for axis in crs.axis_info}
    if directions != {"east", "north"}:
        named = " and ".join(axis.direction for axis in crs.axis_info)
        advice = ADVICE.get(_code(crs), "Use the variant of it whose X grows east and Y north.")
        return f'the axes of "{text}" point {named}, not east and north.', advice
    units = {axis.unit_name for axis in crs.axis_info}
    if units != {"metre"}:
        advice = "Bring ortho, DEM and roads into a CRS in metres (gdalwarp, ogr2ogr)."
        return f'"{text}" counts in {", ".join(sorted(units))}, not in metres.', advice
    return None


def _code(crs: CRS) -> str:
    """`EPSG:n` where there is one, else the name."""
    epsg = crs.to_epsg()
    return f"EPSG:{epsg}" if epsg else crs.name
