"""Which junctions of a synthetic place stood then and stand now."""

import json

import numpy as np

from core.synthetic.lasting import lasting_junctions, lasting_nodes, options_of
from core.synthetic.network import Network, Road

PLACES = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0], [-100.0, 0.0], [0.0, -100.0]])


def road(start, end, **epochs) -> Road:
    line = PLACES[[start, end]]
    return Road(start, end, "track", 0, line, line, **epochs)


def network(*roads) -> Network:
    return Network(PLACES, roads, ())


def test_three_arms_in_both_epochs_make_a_lasting_junction__law():
    arms = [road(0, end) for end in (1, 2, 3)]
    np.testing.assert_array_equal(lasting_nodes(network(*arms)), PLACES[:1])
    np.testing.assert_array_equal(lasting_nodes(network(*arms[:2])), np.zeros((0, 2)))


def test_arms_that_were_built_or_ploughed_over_since_do_not_count__law():
    stood, stands = road(0, 3, exists_now=False), road(0, 4, existed_then=False)
    both = [road(0, 1), road(0, 2)]
    assert len(lasting_nodes(network(*both, stood))) == 0
    assert len(lasting_nodes(network(*both, stands))) == 0
    assert len(lasting_nodes(network(*both, stood, stands))) == 0


def test_options_are_those_the_block_was_made_with__law(tmp_path):
    (tmp_path / "truth").mkdir()
    said = {"size": "tiny", "epoch": 1938, "relief_m": 80.0, "seed": 7, "road_change": 0.5}
    path = tmp_path / "truth" / "truth.json"
    path.write_text(json.dumps({"args": said}), encoding="utf-8")
    options = options_of(tmp_path)
    assert (options.size, options.epoch, options.seed, options.change) == ("tiny", 1938, 7, 0.5)
    path.write_text(json.dumps({"args": {**said, "road_change": 0.33}}), encoding="utf-8")
    assert options_of(tmp_path).change is None


def test_lasting_junctions_of_a_block_lie_on_its_map__truth(tiny_block):
    """Some junctions of today's map are new, and every lasting one lies within the landscape."""
    places = lasting_junctions(tiny_block)
    assert len(places) >= 5
    assert len(np.unique(places, axis=0)) == len(places)
