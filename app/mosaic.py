"""The mosaic in a block's results, and the layer of what has changed since.

Edited seams are kept, and tiles that are still right are taken over.
"""

from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np
import shapely
from pyogrio.errors import DataLayerError, DataSourceError
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from app.epochs import MOSAIC
from app.orthos import read_area
from app.project import Project
from app.surface import chosen_ground
from core.arrays import Position
from core.block import Photo
from core.errors import ProjectError, ReferenceDataError
from core.formats.vectors import read_layers
from core.geometry.camera import Camera
from core.geometry.crs import Bounds, bounds_of, parse_crs
from core.mosaic.change import find_change, write_change
from core.mosaic.composition import (
    FormerMosaic,
    MosaicOptions,
    MosaicProduct,
    compose_mosaic,
    mosaic_grid,
)
from core.mosaic.radiometry import FilmPlane, film_plane
from core.mosaic.seam_cut import SeamGuides
from core.mosaic.seam_edits import SeamEdit, with_edits
from core.mosaic.seam_fit import SeamFit, fit_seams
from core.mosaic.seams import Area, Seam, read_edited, read_seams
from core.orthos.rectification import OrthoProduct
from core.orthos.scan_places import Heights
from core.orthos.visibility import hidden_places
from core.progress import Progress, Work
from core.raster.dem import open_dem
from core.raster.holes import Hole
from core.raster.ortho import Ortho, open_ortho
from core.said import say
from sessions.atomic_write import whole_file
from sessions.checks import keep_written
from sessions.products import Products
from sessions.seam_decisions import standing_seam_edits
from sessions.session import Session

SEAMS = "seams.gpkg"
TILES = "mosaic-tiles"
"""Product that keeps the digests of the tiles of the file that is there."""
SEAMS_DRAWN = "seams-drawn"
"""Product that keeps the seams before any edit at the desk, and the edits of the mosaic."""
DRAWN = "mosaic-seams"
"""Product that keeps the digest of the seams that the program drew last."""

NEIGHBOURS = "seam-fit"
"""Product that keeps how well photos fit along the seams."""

# design: a fine DSM; the spacing of heights of which none is known, as on bridges
LEAST_STEP_M = 0.25
"""Between the samples of a ray to a hole, metres."""
CHANGE = "change.gpkg"
REFERENCE = "reference"
"""The `tone` of a mosaic that looks like the reference ortho."""


def make_mosaic(
    session: Session,
    project: Project,
    orthos: Sequence[OrthoProduct],
    progress: Progress,
    anew: bool = False,
) -> MosaicProduct:
    """The mosaic of the orthos, unless it is fresh.

    Seams edited in `seams.gpkg` hold alone, but for ground that their photo does not show. Only
    tiles are composed of which an ortho, its tone or a seam has changed.

    Args:
        session: Where results are kept.
        project: For what guides seams, for dates and tones.
        orthos: All orthos of the block.
        progress: Told per photo and tile; may raise `Cancelled`.
        anew: Compose every tile again.

    Raises:
        ReferenceDataError: Seams were edited so that they cannot be used, or a layer is damaged.
    """
    products = session.products
    target, seams = session.results / MOSAIC, session.results / SEAMS
    options = MosaicOptions(balance=project.ortho.balance, area=read_area(project))
    edited = edited_seams(session)
    hand = ByHand(() if edited else standing_seam_edits(session.decisions()))
    wanted = (list(orthos), options, edited, *hand.if_any, *_looked_at(project))
    inputs = products.digest_of("mosaic", 11, *wanted)
    kept = None if anew else products.load_value("mosaic", products.digest_of(inputs, target))
    if kept is not None and seams.is_file():
        return kept
    grid, names = mosaic_grid(orthos), [ortho.photo_id for ortho in orthos]
    mine = None if edited is None else read_edited(seams, project.block.crs, names)
    guides = seam_guides(project, grid.bounds)
    drawing = whole_file(seams) if mine is None else nullcontext(None)
    with drawing as seams_part, whole_file(target) as mosaic_part:
        composed = compose_mosaic(
            orthos,
            grid,
            mosaic_part,
            seams_part,
            seams=mine,
            dates=project.taken,
            guides=guides,
            planes=film_planes(session, names),
            former=None if anew else _former(products, target),
            stamps={ortho.photo_id: products.digest_of(ortho.path) for ortho in orthos},
            redraw=hand,
            like=_like(project, names),
            options=options,
            progress=progress,
        )
        if seams_part is not None:
            _remember_drawn(session, seams_part)
    products.save_value(SEAMS_DRAWN, inputs, (hand.before, hand.edits))
    left = _far_guides(project, guides) + _seams_left_out(session, edited)
    told = replace(composed, path=target, notes=(*left, *composed.notes))
    holes = _on_ground(composed.holes, project, session)
    return _kept(products, inputs, replace(told, holes=holes))


def _seams_left_out(session: Session, edited: str | None) -> tuple[str, ...]:
    """What becomes of seams laid at the desk where the file was edited outside of it."""
    count = len(standing_seam_edits(session.decisions())) if edited else 0
    alone = (
        "{file} was edited outside of the desk and holds alone: {count:# seam|# seams} laid at "
        "the desk do not lie over it. Delete the file to have seams drawn anew, with them."
    )
    return (say(alone, file=SEAMS, count=count),) if count else ()


def _former(products: Products, path: Path) -> FormerMosaic | None:
    """The mosaic on disk, where the digests of its tiles are known."""
    tiles = products.load_value(TILES, products.digest_of(path))
    return None if tiles is None else FormerMosaic(path, tiles)


def _looked_at(project: Project) -> tuple[Any, ...]:
    """What of a project a mosaic hangs on, besides the orthos."""
    files, tone = project.reference, project.ortho.tone
    taken = sorted(project.taken.items())
    ortho = files.ortho if tone == REFERENCE else ()
    return tuple(_avoided(project).values()), files.roads, taken, tone, ortho


def _like(project: Project, shown: Collection[str]) -> Ortho | str:
    """Whose tone the mosaic is given; a photo that is not shown gives none."""
    tone = project.ortho.tone
    if tone == REFERENCE:
        return open_ortho(project.reference.ortho, project.block.crs)
    return tone if tone in shown else ""


def _on_ground(holes: Sequence[Hole], project: Project, session: Session) -> tuple[Hole, ...]:
    """Holes, told apart by whether the DEM has a height where they are, and what hides them."""
    files = project.reference.dem
    if not holes or not files:
        return tuple(holes)
    places = np.array([(hole.east, hole.north) for hole in holes])
    dem = open_dem(files, project.block.crs)
    unknown = np.isnan(dem.heights(places)).tolist()
    told = tuple(replace(h, without_height=u) for h, u in zip(holes, unknown, strict=True))
    if not project.ortho.visibility:
        return told
    centres = {
        name: kept[0].exterior.centre
        for name in {name for hole in holes for name in hole.masked_in}
        if (kept := _made_with(session, name)) is not None
    }
    # Decks on the way from a hole to a photo count as well.
    nadirs = np.array([centre[:2] for centre in centres.values()]).reshape(-1, 2)
    bounds = bounds_of(np.vstack([places, nadirs]))
    ground, _ = chosen_ground(session, project, dem, bounds)
    return tuple(_hidden(hole, ground, centres) for hole in told)


def _hidden(hole: Hole, heights: Heights, centres: Mapping[str, Position]) -> Hole:
    """A hole with the photos from which something hides it, in its middle or about it."""
    aside = np.sqrt(hole.area_m2) / 3 * np.array([(0, 0), *product((-1, 0, 1), repeat=2)])
    step_m = max(heights.ground_sample_distance_m, LEAST_STEP_M)
    places = np.array([hole.east, hole.north]) + aside
    hidden = tuple(
        name
        for name in hole.masked_in
        if any(hidden_places(centres[name], heights, place[None], step_m)[0] for place in places)
    )
    masked = tuple(name for name in hole.masked_in if name not in hidden)
    return replace(hole, masked_in=masked, hidden_in=hidden)


def _kept(products: Products, inputs: str, product: MosaicProduct) -> MosaicProduct:
    """A mosaic that is whole on disk, kept with its tiles and with what its file looks like."""
    products.save_value(TILES, products.digest_of(product.path), product.tiles)
    products.save_value("mosaic", products.digest_of(inputs, product.path), product)
    keep_written(products, product.path)
    return product


class ByHand:
    """Lays the edits that stand over the seams of a mosaic, and keeps those from before."""

    def __init__(self, edits: tuple[SeamEdit, ...]) -> None:
        self.edits = edits
        self.before: tuple[Seam, ...] = ()

    def __call__(self, seams: tuple[Seam, ...], shown: Mapping[str, Area]) -> tuple[Seam, ...]:
        """The seams after the edits."""
        self.before = seams
        return with_edits(seams, self.edits, shown)

    @property
    def if_any(self) -> tuple[tuple[SeamEdit, ...], ...]:
        """The edits, where there are any: without, digests stay those of a mosaic without."""
        return (self.edits,) if self.edits else ()


def check_guides(project: Project) -> tuple[str, ...]:
    """What is to be told of what seams avoid, before anything is computed.

    Raises:
        ProjectError: The mosaic is to have the tone of what is not there.
        ReferenceDataError: As `seam_guides`.
        CrsError: Coordinates do not fit the CRS a layer names, or none can be found for it.
    """
    files, crs, tone = project.reference, project.block.crs, project.ortho.tone
    known = [REFERENCE] if files.ortho else list[str]()
    if tone and tone not in (*known, *(scan.photo_id for scan in project.scans.listed)):
        raise ProjectError(
            project.file,
            say("[ortho] tone: neither a scan nor a reference ortho is {tone!r}.", tone=tone),
            'Name a scan without its ending, "reference" where there is an ortho, or nothing.',
        )
    if not any(_avoided(project).values()):
        return ()
    bounds = open_ortho(files.ortho, crs).bounds if files.ortho else None
    return _far_guides(project, seam_guides(project, bounds))


def seam_guides(project: Project, bounds: Bounds | None) -> SeamGuides:
    """What guides the seams of a block within bounds, everywhere without any.

    Raises:
        ReferenceDataError: A layer cannot be read, or has no polygons where they are asked for.
    """
    crs, reference = parse_crs(project.block.crs, project.file), project.reference
    roads, _ = _shapes(reference.roads, crs, bounds, 1)
    avoided = {
        name: () if file is None else _outlines(file, crs, bounds)
        for name, file in _avoided(project).items()
    }
    return SeamGuides(roads=roads, **avoided)


def _avoided(project: Project) -> dict[str, Path | None]:
    """The layers of polygons that seams avoid, by what they hold."""
    files = project.reference
    return {"buildings": files.buildings, "woods": files.woods, "water": files.water}


def _outlines(file: Path, crs: CRS, bounds: Bounds | None) -> tuple[BaseGeometry, ...]:
    found, other = _shapes((file,), crs, bounds, 2)
    if other and not found:
        raise ReferenceDataError(
            file,
            "it has no polygons in the block, so seams would not avoid what it holds.",
            "Give outlines as polygons: lines that close can be turned into them in a GIS.",
        )
    return found


def _shapes(
    files: Sequence[Path], crs: CRS, bounds: Bounds | None, dimension: int
) -> tuple[tuple[BaseGeometry, ...], int]:
    """Polygons (of dimension 2) or lines (1) of some layers, and the number of other shapes."""
    found, other = list[BaseGeometry](), 0
    for file in files:
        for layer in read_layers(file, crs, bounds, attributes=False):
            parts = shapely.get_parts(layer.geometries)
            wanted = shapely.get_dimensions(parts) == dimension
            found.extend(parts[wanted])
            other += int(np.count_nonzero(~wanted))
    return tuple(found), other


def _far_guides(project: Project, guides: SeamGuides) -> tuple[str, ...]:
    """A note for each layer that seams should avoid and of which nothing lies in the block."""
    alone = "{name} has nothing in the block that seams could avoid."
    layers = _avoided(project).items()
    far = [file for kind, file in layers if file is not None and not getattr(guides, kind)]
    return tuple(say(alone, name=file.name) for file in far)


def film_planes(session: Session, photo_ids: Sequence[str]) -> Mapping[str, FilmPlane]:
    """Where the ground lies on the film each ortho was made from."""
    made = {name: _made_with(session, name) for name in photo_ids}
    return {name: film_plane(*kept) for name, kept in made.items() if kept is not None}


def _made_with(session: Session, name: str) -> tuple[Photo, Camera] | None:
    """Photo and camera that an ortho was made with, where that is known."""
    return cast("tuple[Photo, Camera] | None", session.products.latest_value(f"made-with/{name}"))


def edited_seams(session: Session) -> str | None:
    """Digest of what the file of seams holds where the program did not draw it."""
    seams = session.results / SEAMS
    if not seams.is_file():
        return None
    content = _content(session, seams)
    return None if content in _drawn(session) else content


def _drawn(session: Session) -> tuple[str, ...]:
    """Digests of the seams that the program drew last and before."""
    products = session.products
    kept: tuple[str, ...] | None = products.load_value(DRAWN, products.digest_of(DRAWN))
    if kept is not None:
        return kept
    # Earlier versions kept only what they composed, and composed what they drew.
    former = cast("MosaicProduct | None", products.latest_value("mosaic"))
    return () if former is None else (products.digest_of(DRAWN, list(former.seams)),)


def _remember_drawn(session: Session, seams: Path) -> None:
    """Keep what was drawn, before its file takes the place of the last: either may be there."""
    products = session.products
    both = (_content(session, seams), *_drawn(session)[:1])
    products.save_value(DRAWN, products.digest_of(DRAWN), both)


def _content(session: Session, seams: Path) -> str:
    """Digest of the seams in a file, whatever a GIS that only opened it wrote around them."""
    try:
        return session.products.digest_of(DRAWN, list(read_seams(seams)))
    except (DataSourceError, DataLayerError, KeyError):
        return session.products.digest_of(DRAWN, seams)


def kept_orthos(session: Session, mosaic: MosaicProduct) -> tuple[OrthoProduct, ...]:
    """The orthos that a mosaic shows, as they were made last."""
    names = dict.fromkeys(seam.photo_id for seam in mosaic.seams)
    found = (session.products.latest_value(f"ortho/{name}") for name in names)
    return tuple(cast("OrthoProduct", one) for one in found if one is not None)


def compare_neighbours(
    session: Session, mosaic: MosaicProduct, work: Work, *, anew: bool = False
) -> tuple[SeamFit, ...]:
    """How well photos fit along the seams of a mosaic, unless that is fresh.

    Args:
        session: Where the product is kept.
        mosaic: The mosaic, on disk.
        work: Compares side by side and is told of each; may raise `Cancelled`.
        anew: Compare again.
    """
    products = session.products
    digest = products.digest_of(NEIGHBOURS, 3, mosaic.path)
    kept: tuple[SeamFit, ...] | None = None if anew else products.load_value(NEIGHBOURS, digest)
    if kept is None:
        kept = fit_seams(mosaic, kept_orthos(session, mosaic), work)
        products.save_value(NEIGHBOURS, digest, kept)
    return kept


def make_change(
    session: Session,
    project: Project,
    mosaic: MosaicProduct,
    progress: Progress,
    *,
    anew: bool = False,
) -> Mapping[str, float]:
    """Write the layer unless it is fresh.

    Args:
        session: Where results are kept.
        project: For the reference.
        mosaic: The mosaic, on disk.
        progress: Told per tile.
        anew: Make it again.

    Returns:
        Share of the ground that is the same, and that is different; nothing without a reference.
    """
    crs, reference = project.block.crs, project.reference.ortho
    if not reference:
        return {}
    target = session.results / CHANGE
    digest = session.products.digest_of("change", 1, mosaic.path, reference)
    kept = None if anew else session.products.load_value("change", digest)
    if kept is not None and target.is_file():
        return kept
    found = find_change(
        open_ortho([mosaic.path], crs), open_ortho(reference, crs), mosaic.grid.bounds,
        progress=progress,
    )  # fmt: skip
    with whole_file(target) as temporary:
        write_change(found, temporary, crs)
    session.products.save_value("change", digest, found.shares)
    return found.shares
