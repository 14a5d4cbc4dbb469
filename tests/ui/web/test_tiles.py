"""Tiles over HTTP: drawn once, kept, and fitting together."""

import asyncio

import cv2
import numpy as np
import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from tests.ui.desk_block import CAMERA, tiny_block, true_photos
from ui.review.compare import DrawnPhoto, drawn_from_block
from ui.review.photo_points import corrections_part
from ui.review.tiles import TILE, Lattice
from ui.web.tiles import Sources, TileStore, as_veil, encoded_tile, tile_routes


@pytest.fixture(scope="module")
def drawn() -> DrawnPhoto:
    photo = true_photos(1200, tiny_block().land.dem)["1938_01_015"]
    return DrawnPhoto(photo, CAMERA, 1)


@pytest.fixture
def store():
    tiny = tiny_block()
    lattice = Lattice.over(tiny.land.today.bounds, 0.5)
    made = TileStore(Sources(tiny.land.today, tiny.land.dem, tiny.scans, lattice))
    yield made
    made.close()


def test_tiles_of_even_contrast_fit_together__law(drawn):
    tiny = tiny_block()
    lattice = Lattice.over(tiny.land.today.bounds, 0.5)
    store = TileStore(Sources(tiny.land.today, tiny.land.dem, tiny.scans, lattice))
    left = store.scan(drawn, lattice.tile(0, 8, 6), True).astype(float)
    right = store.scan(drawn, lattice.tile(0, 9, 6), True).astype(float)
    within = np.abs(np.diff(left, axis=1)).mean()
    between = np.abs(right[:, 0] - left[:, -1]).mean()
    assert between < 2 * within + 2
    assert store.ortho((0, 8, 6), True).shape == (TILE, TILE, 3)
    assert store.raw(drawn, (0, 1, 1), True).shape == (TILE, TILE)
    store.close()


def test_a_tile_is_drawn_once_and_then_kept__law(store):
    drawings = []

    def draw():
        drawings.append(1)
        return np.full((TILE, TILE), 77, np.uint8)

    async def ask():
        return [await store.tile("/tiles/x", draw) for _ in range(3)]

    first, *others = asyncio.run(ask())
    assert all(other == first for other in others)
    assert len(drawings) == 1


def test_an_encoded_tile_has_the_colours_it_was_given__oracle():
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[..., 0] = 200
    read = cv2.imdecode(np.frombuffer(encoded_tile(picture), np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(read[..., ::-1].astype(int) - picture).max() < 6


def test_a_veil_is_clear_where_nothing_is_alike_and_dense_at_the_peak__oracle():
    values = np.zeros((32, 32))
    values[10, 20] = 1.0
    read = cv2.imdecode(np.frombuffer(as_veil(values), np.uint8), cv2.IMREAD_UNCHANGED)
    assert read[0, 0, 3] == 0
    assert read[10, 20, 3] > 200


def test_addresses_beyond_reason_are_not_there__law(store, drawn):
    store.publish({"a": drawn})

    async def visit():
        application = web.Application()
        application.add_routes(tile_routes(store))
        async with TestServer(application) as server, TestClient(server) as client:
            there = await client.get("/tiles/ortho/0/8/6")
            assert (there.status, there.content_type) == (200, "image/jpeg")
            endless = "9" * 5000
            for path in (
                "/tiles/ortho/99/0/0",
                "/tiles/ortho/0/9999999999/0",
                f"/tiles/ortho/0/{endless}/0",
            ):
                assert (await client.get(path)).status == 404, path

    asyncio.run(visit())


class HalfMosaic:
    """A mosaic that shows the eastern half of the ground in one gray."""

    def __init__(self, split: float) -> None:
        self.split = split
        self.bounds = (split - 1000.0, -1e6, split + 1000.0, 1e6)
        self.ground_sample_distance_m = 0.5

    def read_colour(self, grid):
        across, _ = grid.centres()
        gray = np.where(across > self.split, 120, 0).astype(np.uint8)
        return np.repeat(np.repeat(gray[None, :, None], grid.rows, 0), 3, 2)


def test_each_year_has_tiles_of_its_own__law():
    tiny = tiny_block()
    lattice = Lattice.over(tiny.land.today.bounds, 0.5)
    old = HalfMosaic(lattice.west)
    old.bounds = tiny.land.today.bounds
    sources = Sources(tiny.land.today, tiny.land.dem, tiny.scans, lattice, years=(old,))
    store = TileStore(sources)
    place = (2, 1, 1)
    year, today = store.ortho(place, False, 0), store.ortho(place, False)
    assert np.array_equal(year, old.read_colour(lattice.tile(*place)))
    assert not np.array_equal(year, today)
    with pytest.raises(web.HTTPNotFound):
        store.ortho(place, False, 1)
    store.close()


def test_the_mosaic_is_clear_where_it_shows_nothing_and_a_jpeg_where_it_is_whole__law():
    tiny = tiny_block()
    lattice = Lattice.over(tiny.land.today.bounds, 0.5)
    split = lattice.west + 1.5 * TILE * lattice.pixel_m
    asked = []

    def mosaic(version, edition):
        asked.append((version, edition))
        return HalfMosaic(split) if version == 7 else None

    store = TileStore(Sources(tiny.land.today, tiny.land.dem, tiny.scans, lattice, mosaic=mosaic))
    application = web.Application()
    application.add_routes(tile_routes(store))

    async def ask():
        async with TestClient(TestServer(application)) as client:
            found = []
            for address in (
                "7/0/0/1/0",
                "7/0/0/2/0",
                "7/5/0/1/0?wallis=1",
                "8/0/0/1/0",
                f"{'9' * 16}/0/0/1/0",
            ):
                answer = await client.get(f"/tiles/mosaic/{address}")
                found.append((answer.status, answer.content_type, await answer.read()))
            return found

    half, whole, even, none, absurd = asyncio.run(ask())
    store.close()
    assert half[:2] == (200, "image/png")
    picture = cv2.imdecode(np.frombuffer(half[2], np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (TILE, TILE, 4)
    assert np.array_equal(picture[0, :, 3] > 0, np.arange(TILE) >= TILE // 2)
    assert np.unique(picture[:, TILE // 2 :, :3]).tolist() == [120]
    assert whole[:2] == (200, "image/jpeg")
    evened = cv2.imdecode(np.frombuffer(even[2], np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(evened[..., 3], picture[..., 3])
    assert (none[0], absurd[0]) == (404, 404)
    assert asked == [(7, 0), (7, 0), (7, 5), (8, 0)]


def test_corrections_at_a_place_are_told_as_numbers__law():
    """In both frames; a place or a frame that is none is refused."""
    tiny = tiny_block()
    lattice = Lattice.over(tiny.land.today.bounds, 0.5)
    store = TileStore(Sources(tiny.land.today, tiny.land.dem, tiny.scans, lattice))
    drawn = drawn_from_block(tiny.block)
    store.publish(drawn)
    name, application = next(iter(drawn)), web.Application()
    application.add_routes(tile_routes(store))

    async def visit():
        async with TestServer(application) as server, TestClient(server) as client:
            answer = await client.get(f"/tiles/corrections/{name}/1/scan/200.5/300")
            rows = await answer.json()
            assert [row[0] for row in rows][-1] == "together"
            place = np.array([[200.5, 300.0]])
            assert rows == corrections_part(drawn[name], tiny.land.dem, "scan", place)
            for path in ("1/sky/1/1", "1/scan/1/nan", "1/scan/inf/1", "9/scan/1/1", "1/scan/x/1"):
                answer = await client.get(f"/tiles/corrections/{name}/{path}")
                assert answer.status == 404, path

    asyncio.run(visit())
