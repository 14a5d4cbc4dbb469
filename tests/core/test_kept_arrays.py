"""Arrays laid by in a file come back as they were."""

import tempfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from core.errors import PhotogrammetryError
from core.kept_arrays import KeptArrays


def test_arrays_come_back_whichever_thread_asks__law() -> None:
    rng = np.random.default_rng(1)
    arrays = [
        rng.integers(0, 255, (n, 128)).astype(dtype)
        for n, dtype in enumerate([np.uint8, np.float16, np.float64] * 20)
    ]
    store = KeptArrays()
    with ThreadPoolExecutor(4) as pool:
        kept = list(pool.map(store.keep, arrays))
        for array, back in zip(arrays, pool.map(lambda one: one.read(), kept), strict=True):
            assert back.dtype == array.dtype
            np.testing.assert_array_equal(back, array)


def test_an_array_gives_way_to_one_as_large_and_no_other_does__law() -> None:
    store = KeptArrays()
    first, beside = store.keep(np.zeros(4)), store.keep(np.ones(4))
    again = store.keep(np.full(4, 2.0), first)
    larger = store.keep(np.full(5, 3.0), again)
    assert again.start == first.start
    assert larger.start > beside.start
    assert beside.read().tolist() == [1.0] * 4
    assert again.read().tolist() == [2.0] * 4


def test_a_full_disk_is_told__truth(monkeypatch: pytest.MonkeyPatch) -> None:
    with open("/dev/full", "r+b", buffering=0) as full:
        monkeypatch.setattr(tempfile, "TemporaryFile", lambda prefix: full)
        with pytest.raises(PhotogrammetryError, match="cannot be laid by"):
            KeptArrays().keep(np.zeros(4))
