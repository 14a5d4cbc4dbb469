"""Which mark is which: what a certificate says, what it cannot say, and what is then told."""

import numpy as np
import pytest

from core.scans.film_area import FilmArea
from core.scans.judging import names_guessed
from core.scans.naming import UPRIGHT, WAYS, Way, lying, name_marks

SIGMAS = np.full(4, 0.02)
ODD = {"1": (-26.4, 26.0), "2": (26.0, 25.6), "3": (25.5, -26.0), "4": (-26.0, -26.3)}
NEARLY = {"1": (-26.0, 26.0), "2": (26.004, 26.0), "3": (26.0, -26.0), "4": (-26.0, -26.0)}
STRETCHED = np.array([1.0004, 0.9997])


def scanned(certificate: dict[str, tuple[float, float]], way: Way) -> np.ndarray:
    """Pixels of 40 um on which a film lies that has shrunk unevenly."""
    film = lying(np.array(list(certificate.values())) * STRETCHED, way)
    return 700 + film * np.array([1.0, -1.0]) / 0.04


@pytest.mark.parametrize("way", WAYS)
def test_an_uneven_certificate_names_every_way_to_lie__truth(way: Way) -> None:
    naming = name_marks(list(ODD), scanned(ODD, way), SIGMAS, way, ODD)
    assert naming.way == way
    assert naming.names == tuple(ODD)
    assert not naming.guessed


def test_names_from_another_way_are_put_right__truth() -> None:
    """From afar the marks were taken to lie upright; they lie mirrored."""
    pixels = scanned(ODD, (0, True))
    naming = name_marks(["2", "1", "4", "3"], pixels, SIGMAS, UPRIGHT, ODD)
    assert naming.way == (0, True)
    assert naming.names == tuple(ODD)


def test_an_even_certificate_leaves_upright_and_rivals__truth() -> None:
    naming = name_marks(list(NEARLY), scanned(NEARLY, UPRIGHT), SIGMAS, UPRIGHT, NEARLY)
    assert naming.way == UPRIGHT
    assert len(naming.rivals) == 7
    assert not naming.guessed
    preferred = name_marks(
        list(NEARLY), scanned(NEARLY, UPRIGHT), SIGMAS, UPRIGHT, NEARLY, ((2, False),)
    )
    assert preferred.way == (2, False)
    assert not preferred.guessed


def test_a_certificate_that_hardly_tells_is_doubted__truth() -> None:
    """Forty micrometres tell something, but a film may bend by as much."""
    hardly = {**NEARLY, "2": (26.04, 26.0)}
    seen_upright = ["4", "1", "2", "3"]
    naming = name_marks(seen_upright, scanned(hardly, (1, False)), SIGMAS, UPRIGHT, hardly)
    assert naming.rivals
    assert naming.guessed
    doubt = names_guessed("a", naming.way)
    assert doubt.kind == "fiducial-names"
    assert "neighbours" in doubt.message


def test_the_border_names_three_marks_that_a_mirror_shows_alike__truth() -> None:
    """Two equally far from the third change places in a mirror; the frame would lie aslant then."""
    third, along = np.array([-26.5, 0.1]), 26.5 * np.array([np.cos(0.01), np.sin(0.01)])
    across = np.array([-along[1], along[0]])
    places = {"5": third + along + across, "7": third + along - across, "8": third}
    alike = {name: (float(x), float(y)) for name, (x, y) in places.items()} | {"6": (26.3, 0.4)}
    seen = {name: alike[name] for name in ("5", "7", "8")}
    pixels = scanned(seen, (0, True))
    middle, half = 700.0, 30.0 / 0.04
    corners = middle + half * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
    area = FilmArea(corners, ("left", "right", "top", "bottom"), np.ones(4))
    alone = name_marks(list(seen), pixels, SIGMAS[:3], (0, True), alike)
    assert alone.guessed
    told = name_marks(["7", "5", "8"], pixels, SIGMAS[:3], (2, False), alike, (), area)
    assert told.way == (0, True)
    assert told.names == ("5", "7", "8")
    assert not told.rivals
