"""Ways to spoil a copy of a block, as its owner might by mistake."""

import warnings
from collections.abc import Callable

import numpy as np
import pyogrio.raw
import rasterio
import shapely
from rasterio.errors import NotGeoreferencedWarning
from rasterio.transform import Affine

from tests.journeys.copies import BlockCopy

Axes = Callable[[float, float], tuple[float, float]]


def positive(east: float, north: float) -> tuple[float, float]:
    """S-JTSK as on paper, but west first."""
    return -east, -north


def swapped(east: float, north: float) -> tuple[float, float]:
    """Northing before easting."""
    return north, east


def positive_swapped(east: float, north: float) -> tuple[float, float]:
    """S-JTSK as on paper: X to the south, then Y to the west."""
    return -north, -east


def add_line(copy: BlockCopy, after: str, line: str) -> None:
    """Put a line behind the table's header in block.toml."""
    text = (copy.folder / "block.toml").read_text()
    assert f"[{after}]\n" in text
    copy.replace("block.toml", text.replace(f"[{after}]\n", f"[{after}]\n{line}\n"))


def without(copy: BlockCopy, *keys: str) -> None:
    """Take keys out of block.toml."""
    lines = (copy.folder / "block.toml").read_text().splitlines()
    kept = [line for line in lines if line.partition(" ")[0] not in keys]
    copy.replace("block.toml", "\n".join(kept))


def cut_off(copy: BlockCopy, name: str, share: float = 0.6) -> None:
    """The first part of a file."""
    content = (copy.folder / name).read_bytes()
    copy.replace(name, content[: int(share * len(content))])


def pixels_changed(
    copy: BlockCopy, name: str, change: Callable[[np.ndarray], np.ndarray], **profile: object
) -> None:
    """A raster with other pixels."""
    path = copy.folder / name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path) as file:
            values, kept = file.read(), dict(file.profile)
        values = change(values)
        kept |= {"height": values.shape[1], "width": values.shape[2], "dtype": values.dtype}
        path.unlink()
        with rasterio.open(path, "w", **(kept | profile)) as file:
            file.write(values)


def raster_placed(copy: BlockCopy, name: str, axes: Axes, **profile: object) -> None:
    """A raster whose corner lies elsewhere."""
    with rasterio.open(copy.folder / name) as file:
        a, b, c, d, e, f = file.transform[:6]
    east, north = axes(c, f)
    transform = Affine(a, b, east, d, e, north)
    pixels_changed(copy, name, lambda values: values, transform=transform, **profile)


def vector_changed(
    copy: BlockCopy, name: str, axes: Axes | None = None, crs: str | None = "", empty: bool = False
) -> None:
    """A vector file with other coordinates, another CRS (None: none), or no features."""
    path = copy.folder / name
    meta, _, geometry, columns = pyogrio.raw.read(path)
    shapes = shapely.from_wkb(geometry)
    if axes is not None:
        shapes = shapely.transform(shapes, lambda points: np.column_stack(axes(*points.T)))
    kept = slice(0, 0) if empty else slice(None)
    for part in path.parent.glob(f"{path.stem}.*"):
        part.unlink()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "'crs' was not provided")
        pyogrio.raw.write(
            path,
            geometry=shapely.to_wkb(shapes)[kept],
            field_data=[column[kept] for column in columns],
            fields=meta["fields"],
            geometry_type=meta["geometry_type"],
            crs=meta["crs"] if crs == "" else crs,
        )


def world_files(copy: BlockCopy, axes: Axes) -> None:
    """World files whose origin is written in another way."""
    for path in sorted((copy.folder / "scans").glob("*.tfw")):
        *linear, east, north = (float(word) for word in path.read_text().split())
        copy.replace(path, "\n".join(f"{value:.6f}" for value in (*linear, *axes(east, north))))


def exterior_list(copy: BlockCopy, *rows: str) -> None:
    """An EO list as `eo.csv`."""
    header = "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg"
    copy.replace("eo.csv", "\n".join([header, *rows]))
    add_line(copy, "scans", 'exterior = "eo.csv"')


def exterior_placed(copy: BlockCopy, axes: Axes) -> None:
    """An EO list with every scan at one place, written in another way."""
    east, north = axes(-577776.0, -1192961.0)
    exterior_list(copy, *(f"{scan.stem},{east},{north},1631,0,0,0" for scan in copy.scans))


def points_placed(copy: BlockCopy, axes: Axes) -> None:
    """The list of surveyed points, written in another way."""
    east, north = axes(-577776.0, -1192961.0)
    copy.replace("points.csv", f"id,X,Y,Z,sigma_xy,sigma_z,role\nA,{east},{north},240,,,\n")
    text = (copy.folder / "block.toml").read_text()
    copy.replace("block.toml", f'{text}\n[control]\npoints = "points.csv"\n')
