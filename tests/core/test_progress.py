"""Work and its chance."""

import numpy as np

from core.progress import Work


def test_chance_depends_on_names_alone__law():
    block = Work(seed="block")
    one, same, other = (block.random(name).random(4) for name in ("a", "a", "b"))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    assert (Work(seed="elsewhere").random("a").random(4) != one).any()


def test_a_part_tells_its_share_of_the_whole__law():
    told = []

    class Listener:
        def report(self, done, total, what=""):
            told.append(done / total)

    Work(Listener()).part(0.2, 0.6).part(0.5, 1.0).progress.report(1, 2)
    np.testing.assert_allclose(told, [0.5])
