"""Nothing decided is lost, nothing is doubled, and what is foretold comes true.

Run: python -m tests.benchmarks.prove_desk [effect] [kills] [pages] [memory] [--count N]

effect  what the desk says a decision would do against what it did, 500 decisions
kills   `kill -9` of the desk at random between and within decisions, 200 times
pages   two pages with 500 decisions each at the same time
memory  thousands of gestures from ten pages: resident memory after each quarter of them
"""

import argparse
import asyncio
import json
import multiprocessing
import os
import random
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import aiohttp
import numpy as np
import psutil

from app.desk.inputs import Adjusting
from app.desk.wiring import open_desk
from core.adjustment.adjusted import AdjustmentOptions
from sessions.decisions import Accept, Reject
from sessions.session import Session
from tests.benchmarks.large_desk import Size, large_block, say, say_row
from tests.ui.desk_block import desk_inputs
from ui.review.compare import made_with
from ui.review.rows import queue_rows
from ui.review.state import DeskState
from ui.review.trial import largest_shift, trial_of, turn_measurement
from ui.web.access import Door

PAGES, MOST_GROWTH = 10, 10.0
TOKEN = "benchmark-token-benchmark-token-0"
STATES = {"reject": "rejected", "dubious": "dubious", "accept": "accepted"}
"""What each verdict makes of a row."""


def effect(count: int) -> bool:
    """Every decision is tried out first, then made; the figures must be the same to 1 %."""
    made = large_block(Size(3, 4, 700, 900))
    adjust = Adjusting(AdjustmentOptions())
    state = DeskState(made.block, adjust(made.block), made={})
    state = replace(state, made=made_with(state.report.block))
    worst = {"sigma nought": 0.0, "largest shift": 0.0, "neighbours' misfits": 0.0}
    told = 0
    with tempfile.TemporaryDirectory() as folder, Session.open(Path(folder), "anna") as session:
        rng = random.Random(3)
        while told < count:
            rows = [row for row in queue_rows(state) if row.role == "control" and not row.human]
            key = rng.choice(rows).key
            block = turn_measurement(state, key, lambda _: made.block)
            assert block is not None
            trial = trial_of(state, key, adjust(block))
            if trial is None:
                continue
            session.record(Reject(*key, "other") if trial.rejects else Accept(*key), made.block)
            after = session.replayed(made.block)
            before, report = state.oriented, adjust(after)
            shift, _ = largest_shift(before, report.block)
            then = replace(state, block=after, report=report)
            _worse(worst, "sigma nought", trial.sigma_nought, report.sigma_nought)
            _worse(worst, "largest shift", trial.shift_m, shift)
            for beside in trial.neighbours:
                row = next(row for row in queue_rows(then) if row.key == beside.key)
                _worse(worst, "neighbours' misfits", beside.then_px, row.misfit_px)
            state, told = then, told + 1
    printed = ", ".join(f"{name} {100 * off:.3f} %" for name, off in worst.items())
    say_row("what a decision would do, against what it did", f"worst of {told}: {printed}")
    return max(worst.values()) <= 0.01


def _worse(worst: dict[str, float], name: str, foretold: float, came: float) -> None:
    worst[name] = max(worst[name], abs(foretold - came) / max(abs(came), 1e-6))


@dataclass(frozen=True)
class Page:
    """A page without a browser: what is sent and what comes back over the same wire."""

    socket: aiohttp.ClientWebSocketResponse
    parts: dict

    async def until(self, test: Callable[[dict], bool], seconds: float = 60) -> None:
        end = time.monotonic() + seconds
        while not test(self.parts):
            left = end - time.monotonic()
            assert left > 0, "waited too long"
            message = await self.socket.receive(timeout=left)
            if message.type != aiohttp.WSMsgType.TEXT:
                raise ConnectionError
            self.take(json.loads(message.data))

    def take(self, fresh: dict) -> None:
        rows = self.parts.setdefault("rows", {})
        for name in [name for name in fresh if name.startswith("rows/")]:
            piece = fresh.pop(name)
            if name != "rows/count":
                rows |= {int(name[5:]) * 50 + i: row for i, row in enumerate(piece)}
        self.parts.update(fresh)

    @property
    def current(self) -> list[str]:
        """The measurement that is shown; none once all are decided."""
        return self.parts["rows"].get(self.parts["queue"]["current"], [])[:2]


async def opened_page(session: aiohttp.ClientSession, port: int, seat: str) -> Page:
    """A page at a seat, once everything is on it."""
    root = f"http://127.0.0.1:{port}"
    async with session.get(f"{root}/?token={TOKEN}") as answer:
        assert answer.status == 200
    page = Page(await session.ws_connect(f"{root}/desk/{seat}"), {})
    await page.until(lambda parts: "queue" in parts and "status" in parts and parts["rows"])
    return page


def serve(folder: str, port: int) -> None:
    """A desk on the tiny block in a process of its own."""
    inputs = desk_inputs(Path(folder), token=TOKEN, door=Door(port=port))
    with open_desk(inputs) as desk:
        desk.wait()


def kills(count: int) -> bool:
    """Decide, kill at random, open again: what was shown as saved must be there."""
    desk_inputs(Path(tempfile.mkdtemp())).session.close()
    rng, shown, sent, back = random.Random(7), 0, 0, list[float]()
    port = _free_port()
    fork = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(count):
            process = fork.Process(target=serve, args=(folder, port), daemon=True)
            process.start()
            begun = time.perf_counter()
            assert process.pid is not None
            known, asked, ready = asyncio.run(_decide_until_killed(port, process.pid, rng))
            back.append(ready - begun)
            process.join()
            with Session.open(Path(folder), "reader") as session:
                recorded = session.decisions()
            numbers = [item.decision_id for item in recorded]
            assert numbers == list(range(1, len(numbers) + 1)), "a decision is missing"
            if len(recorded) < known:
                say(f"LOST: {known} were shown, {len(recorded)} are there")
                return False
            shown, sent = shown + 1, sent + asked
    printed = f"kill -9 {shown} times between and within {sent} decisions: none lost that was shown"
    printed += f"; {len(recorded)} on disk; open again after {np.median(back):.2f} s in the median"
    say_row("decisions kept when the desk is killed", printed)
    return True


async def _decide_until_killed(port: int, pid: int, rng: random.Random) -> tuple[int, int, float]:
    """(decisions shown as saved, decisions asked for, when the page was there)."""
    known = asked = 0
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        page = await _patiently(session, port)
        ready = time.perf_counter()
        killing = asyncio.get_running_loop().call_later(
            rng.uniform(0.0, 0.5), lambda: os.kill(pid, signal.SIGKILL)
        )
        with suppress(ConnectionError, aiohttp.ClientError, TimeoutError):
            while True:
                decided = page.parts["status"]["decided"]
                known = max(known, decided)
                row = rng.choice(list(page.parts["rows"].values()))
                verdict = rng.choice([name for name, state in STATES.items() if state != row[3]])
                await page.socket.send_json({"kind": "judge", "key": row[:2], "verdict": verdict})
                asked += 1
                await page.until(lambda parts, d=decided: parts["status"]["decided"] > d, 2)
        killing.cancel()
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return known, asked, ready


async def _patiently(session: aiohttp.ClientSession, port: int) -> Page:
    for _ in range(400):
        with suppress(aiohttp.ClientError, ConnectionError):
            return await opened_page(session, port, "killed-page")
        await asyncio.sleep(0.05)
    raise TimeoutError


def pages(count: int) -> bool:
    """Two pages decide at the same time, each under a name of its own."""
    with tempfile.TemporaryDirectory() as folder:
        inputs = desk_inputs(Path(folder), token=TOKEN)
        with open_desk(inputs) as desk:
            begun = time.perf_counter()
            asyncio.run(_both(desk.port, count))
            seconds = time.perf_counter() - begun
        recorded = inputs.session.decisions()
        inputs.session.close()
    by_name = {name: sum(item.who == name for item in recorded) for name in ("berta", "cyril")}
    printed = f"{count} each: {len(recorded)} on disk, {by_name}, {seconds:.0f} s"
    say_row("two clients deciding at the same time", printed)
    return len(recorded) == 2 * count and set(by_name.values()) == {count}


async def _both(port: int, count: int) -> None:
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        await asyncio.gather(*(_many(session, port, name, count) for name in ("berta", "cyril")))


async def _many(session: aiohttp.ClientSession, port: int, name: str, count: int) -> None:
    """Decisions that each change something, one after the other, counted in the history."""
    page = await opened_page(session, port, f"seat-{name}")
    await page.socket.send_json({"kind": "name", "name": name})
    await page.until(lambda parts: parts["status"]["operator"] == name)
    keys = sorted(row[:2] for row in page.parts["rows"].values() if row[2] == "control")
    mine = keys[::2] if name == "berta" else keys[1::2]
    for number in range(count):
        key = mine[number % len(mine)]
        verdict = tuple(STATES)[number // len(mine) % 2]
        await page.socket.send_json({"kind": "select", "key": key})
        await page.until(lambda parts, k=key: page.current == k)
        await page.socket.send_json({"kind": "judge", "key": key, "verdict": verdict})
        place = next(i for i, row in page.parts["rows"].items() if row[:2] == key)
        await page.until(lambda parts, p=place, v=verdict: parts["rows"][p][3] == STATES[v])


def memory(count: int) -> bool:
    """Walk, look, decide and take back, thousands of times, from several pages at once."""
    port = _free_port()
    with tempfile.TemporaryDirectory() as folder:
        # Spawned: a fork would count what the hand holds.
        spawned = multiprocessing.get_context("spawn")
        desk = spawned.Process(target=serve, args=(folder, port), daemon=True)
        desk.start()
        begun = time.perf_counter()
        told = asyncio.run(_work(port, count, psutil.Process(desk.pid)))
        seconds = time.perf_counter() - begun
        desk.terminate()
        desk.join()
        with Session.open(Path(folder), "reader") as session:
            decided = len(session.decisions())
    growth = 100 * (told[-1] / told[0] - 1)
    printed = ", ".join(f"{one:.0f}" for one in told)
    printed += f" MB ({growth:+.1f} %), {decided} decisions, {seconds:.0f} s"
    say_row(f"memory after each quarter of {count} gestures from {PAGES} pages", printed)
    return growth <= MOST_GROWTH


async def _work(port: int, count: int, desk: psutil.Process) -> list[float]:
    """Gestures, each answered before the next; memory is looked at when all is quiet."""
    told = []
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        await (await _patiently(session, port)).socket.close()
        for _ in range(4):
            busy, share = set(range(PAGES)), count // (4 * PAGES)
            await asyncio.gather(*(_sit(session, port, seat, share, busy) for seat in range(PAGES)))
            told.append(desk.memory_info().rss / 2**20)
    return told


async def _sit(
    session: aiohttp.ClientSession, port: int, seat: int, count: int, busy: set[int]
) -> None:
    """So many gestures at a seat, which listens until all are done and comes back when cut off."""
    kinds = [{"kind": "step", "step": 1}, {"kind": "step", "step": -1}, {"kind": "undo"}]
    number = 0
    while busy:
        page = await opened_page(session, port, f"worker-{seat}")
        with suppress(ConnectionError):
            while number < count:
                message = kinds[number % 3]
                if number % 4 == 0:
                    message = {"kind": "judge", "key": page.current, "verdict": "dubious"}
                number += 1
                await page.socket.send_json(message)
                await page.socket.send_json({"kind": "answer", "number": number})
                await page.until(lambda parts, n=number: parts.get("answered") == n, 600)
            busy.discard(seat)
            while busy:
                await _quiet(page, 2.0)
            await _quiet(page, 2.0)
        await page.socket.close()


async def _quiet(page: Page, seconds: float) -> None:
    """Take all that comes until nothing comes for a while."""
    while True:
        try:
            heard = await page.socket.receive(timeout=seconds)
        except TimeoutError:
            return
        if heard.type is not aiohttp.WSMsgType.TEXT:
            raise ConnectionResetError(str(heard))
        page.take(json.loads(heard.data))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


PROOFS: dict[str, tuple[Callable[[int], bool], int]] = {
    "effect": (effect, 500),
    "kills": (kills, 200),
    "pages": (pages, 500),
    "memory": (memory, 6_000),
}


def main() -> int:
    """Run what is asked for, all by default; 1 when a promise is broken."""
    asked = argparse.ArgumentParser()
    asked.add_argument("proofs", nargs="*", choices=[*PROOFS, []])
    asked.add_argument("--count", type=int)
    given = asked.parse_args()
    kept = True
    for name in given.proofs or PROOFS:
        proof, count = PROOFS[name]
        kept = proof(given.count or count) and kept
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
