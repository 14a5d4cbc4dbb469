"""Accept or doubt measured marks and the interior orientation they give."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.arrays import FilmPoints, PixelPoints
from core.doubts import Doubt, Failure
from core.geometry.interior import InteriorOrientation, fit_interior, limit_um
from core.said import say
from core.scans.measuring import FittedMark, TwoWays
from core.scans.naming import OPPOSITE_MARKS, UPRIGHT, Way, turned_words

LIMIT_PX = 0.5  # design: a hand on a screen; ways that differ by more centre different things
"""Greatest distance between the matched and the second middle, and greatest standard deviation."""
SHOWN_PX = 1.0  # design: half of what is beside an example is picture, which draws both ways aside
"""The same of copies of an example, in pixels in which they were measured; from LIMIT_PX on they
are doubts all the same."""
SURELY_MARK = 0.9  # design: texture does not reach it
"""Correlation from which a place where nothing was seen from afar is a mark."""
MIN_CORRELATION = 0.55  # design: half way between texture and a worn mark
"""Correlation with the drawn mark below which a place is no mark."""
MAX_DROP = 0.25  # design: wear and blur change along a film, but not by as much
"""How much less like the mark than the others a place may be before it is no mark."""
MAX_SPOILT = 4.0  # design: something covers most of it
"""How much more than the usual mark may differ from the drawn one before it is covered."""
DIRT_FROM, DIRT_PX = 1.2, 0.1  # design: noise; a hair across a stroke of some pixels
"""How much more than the usual mark one differs by noise alone, and what dirt that doubles the
difference does to its middle, pixels."""
CLEAN_PERCENT, LEAST_LEFT = 25, 0.01  # design: a quarter of the marks are clean; noise of drawing
"""Marks that tell what is usual, and the least that is left besides a mark."""
UNSURE_PX = 0.048  # measured: prove_fiducials; 0.15 pixels are then not sure to 99.2 per cent
"""Standard deviation, in the direction in which a mark is least sure, from which one that stands is
pointed out."""
SIGMA_FLOOR_PX = 0.006  # design: rounding of grays to 8 bit
"""No mark is believed better than this."""
AFFINITY = 2e-4  # design: 0.02 mm on a side of 100 mm; scanners and film are usually better
"""Difference of the film's scales in x and y that is worth a word."""
SCALE_OFF = 3e-3  # design: ten times the usual shrinkage of film
"""Difference of the film's scale from the nominal that film alone does not explain."""
REPEATED = "repeated"
"""Evidence of a doubt about a mark that stands only because it repeats in its own scan."""
Certificate = Mapping[str, tuple[float, float]]
"""Where marks lie on the film, millimetres, by name."""


@dataclass(frozen=True, slots=True)
class FiducialMeasurement:
    """One fiducial in one scan."""

    name: str
    """Its name in the camera's certificate."""
    column: float
    """Pixels, outer corner of the first pixel (0, 0)."""
    row: float
    """Pixels."""
    sigma_px: float
    """Standard deviation per axis, pixels."""
    correlation: float
    """Likeness to the drawn mark, 0 to 1."""
    disagreement_px: float
    """Distance between its middles found in two ways, pixels."""
    kind: str
    """Shape of the mark."""

    @property
    def place(self) -> tuple[float, float]:
        """Column and row."""
        return self.column, self.row


@dataclass(frozen=True, slots=True)
class FiducialSet:
    """All marks of a scan, and how the film lies by them."""

    marks: tuple[FiducialMeasurement, ...]
    """Those that stand, in the order of the certificate."""
    doubts: tuple[Doubt, ...]
    """One for each that does not."""
    way: Way = UPRIGHT
    """How the film lies in the scan."""
    rivals: tuple[Way, ...] = ()
    """Ways that the certificate cannot tell from it."""
    fitted: tuple[FittedMark, ...] = ()
    """The marks as they look in this scan, a kind for each group."""
    guessed: bool = False
    """True where the certificate hardly tells which mark is which, and nothing else does."""

    @property
    def middle(self) -> tuple[float, float]:
        """Middle of marks opposite to each other, else of the box about all, column and row."""
        at = {mark.name: np.array(mark.place) for mark in self.marks}
        middles = [(at[a] + at[b]) / 2 for a, b in OPPOSITE_MARKS if a in at and b in at]
        if middles:
            column, row = np.mean(middles, axis=0).tolist()
            return column, row
        places = np.array(list(at.values()))
        column, row = ((places.min(axis=0) + places.max(axis=0)) / 2).tolist()
        return column, row


def places_of(marks: Sequence[FiducialMeasurement]) -> PixelPoints:
    """Column and row of marks."""
    return np.array([mark.place for mark in marks], dtype=np.float64).reshape(-1, 2)


def certified_places(marks: Sequence[FiducialMeasurement], certificate: Certificate) -> FilmPoints:
    """Where measured marks lie on the film, millimetres."""
    return np.array([certificate[mark.name] for mark in marks], dtype=np.float64).reshape(-1, 2)


def interior_of(
    marks: Sequence[FiducialMeasurement], certificate: Certificate, back: bool
) -> InteriorOrientation | Failure:
    """Interior orientation from at least two marks.

    Args:
        marks: The marks that were measured.
        certificate: Where they lie on the film, millimetres.
        back: Whether the scan shows the film's back.
    """
    if len(marks) < 2:
        return Failure(
            say(
                "Only {count} of {all} fiducials were measured.",
                count=len(marks),
                all=len(certificate),
            )
        )
    names, sigmas = [mark.name for mark in marks], np.array([mark.sigma_px for mark in marks])
    film = certified_places(marks, certificate)
    return fit_interior(names, places_of(marks), film, "auto", sigmas_px=sigmas, mirrored=back)


def spoilt_by(results: Mapping[str, TwoWays | Failure]) -> dict[str, float]:
    """How much more than in the clean ones is there besides the mark: dirt makes unsure."""
    left = {n: 1 - r.correlation**2 for n, r in results.items() if isinstance(r, TwoWays)}
    least = max(
        float(np.percentile(list(left.values()), CLEAN_PERCENT)) if left else 1.0, LEAST_LEFT
    )
    return {name: max(1.0, float(np.sqrt(max(value, 0.0) / least))) for name, value in left.items()}


def judged_marks(
    results: Mapping[str, TwoWays | Failure], limit_px: float = LIMIT_PX
) -> dict[str, TwoWays | Failure]:
    """Marks that are like the drawn mark, like the others, and alike in both ways.

    Args:
        results: What was measured, by name.
        limit_px: How far the ways to centre a mark may differ, and how sure they must be of it;
            pixels in which it was measured.
    """
    likeness = [r.correlation for r in results.values() if isinstance(r, TwoWays)]
    usual = float(np.median(likeness)) if likeness else 0.0
    least = max(MIN_CORRELATION, usual - MAX_DROP)
    spoilt = spoilt_by(results)
    judged: dict[str, TwoWays | Failure] = {}
    for name, result in results.items():
        judged[name] = result
        if isinstance(result, Failure):
            continue
        if result.correlation < least:
            judged[name] = Failure(
                say(
                    "What is there is not like the mark (correlation {correlation:.2f}).",
                    correlation=result.correlation,
                ),
                {"correlation": result.correlation},
            )
        elif spoilt[name] > MAX_SPOILT:
            judged[name] = Failure(
                say(
                    "Something covers it: it is much less like the drawn mark than the others "
                    "are (correlation {correlation:.2f}).",
                    correlation=result.correlation,
                ),
                {"correlation": result.correlation},
            )
        elif result.sigma_px > limit_px * result.reduction:
            judged[name] = Failure(
                say("Its middle is only known to {sigma_px:.1f} pixels.", sigma_px=result.sigma_px),
                {"sigma_px": result.sigma_px},
            )
        elif (apart := max(result.disagreement_px, result.outline_px)) <= (
            limit_px * result.reduction
        ):
            # Ways that differ by more than usual say how unsure they are.
            usual_apart = apart <= LIMIT_PX * result.reduction
            wide = result.sigma_px if usual_apart else max(result.sigma_px, apart)
            judged[name] = replace(result, sigma_px=wide)
        else:
            judged[name] = Failure(
                say("The ways to centre it differ by {apart:.2f} pixels.", apart=apart),
                {"disagreement_px": apart},
            )
    return judged


def judged_set(
    photo_id: str,
    results: Mapping[str, TwoWays | Failure],
    alike: Mapping[str, TwoWays | Failure],
    predicted: Mapping[str, tuple[float, float]],
    fit: FittedMark,
    limit_px: float = LIMIT_PX,
) -> tuple[list[FiducialMeasurement], list[Doubt]]:
    """The marks that stand, and a doubt about each that does not or is unsure.

    Args:
        photo_id: The photo.
        results: Marks of one kind, measured or not.
        alike: All that they are compared with, themselves included.
        predicted: Where each should be, pixels.
        fit: The mark as it looks in this scan.
        limit_px: How far the ways to centre a mark may differ, and how sure they must be of it.
    """
    marks: list[FiducialMeasurement] = []
    doubts: list[Doubt] = []
    spoilt, judged = spoilt_by(alike), judged_marks(alike, limit_px)
    for name in results:
        result = judged[name]
        if isinstance(result, Failure):
            doubts.append(doubtful_mark(photo_id, name, predicted[name], result))
            continue
        mark = measurement_of(name, result, spoilt[name], fit.mark.shape)
        marks.append(mark)
        doubts += doubt_of_sigma(photo_id, mark, result)
    return marks, doubts


def measurement_of(name: str, result: TwoWays, spoilt: float, kind: str) -> FiducialMeasurement:
    """The fiducial as it stands, what dirt does to it reckoned with.

    Args:
        name: Its name.
        result: Its middle by both ways.
        spoilt: How much more than the clean ones it differs from the drawn mark.
        kind: Shape of the mark.
    """
    dirt = max(spoilt - DIRT_FROM, 0.0)
    sigma = float(np.hypot(max(result.sigma_px, SIGMA_FLOOR_PX), DIRT_PX * dirt))
    return FiducialMeasurement(
        name, result.column, result.row, sigma, result.correlation, result.disagreement_px, kind
    )


def doubt_of_sigma(photo_id: str, mark: FiducialMeasurement, result: TwoWays) -> tuple[Doubt, ...]:
    """A word about a mark that stands, but not firmly."""
    if max(mark.sigma_px, result.worst_px) <= UNSURE_PX * result.reduction:
        return ()
    doubt = Doubt(
        "fiducial-unsure",
        photo_id,
        say(
"Fiducial {name}, at column {column:.1f}, row {row:.1f}, is only known to "
"{sigma_px:.2f} pixels: dirt, a scratch or a blurred mark. Look at it.",
name=mark.name,
column=mark.column,
row=mark.row,
sigma_px=mark.sigma_px
),
        evidence={"fiducial": mark.name, "column": mark.column, "row": mark.row,
                  "sigma_px": mark.sigma_px},
    )  # fmt: skip
    return (doubt,)


def doubt_of_repeated(photo_id: str, mark: FiducialMeasurement) -> Doubt:
    """A word about a mark that is a dot, dim, or of no listed kind, and that nobody showed.

    Its scan tells that something of the camera's is there, not which of its points is the mark: tip
    and foot of a tooth repeat alike. Other scans of the camera may confirm the point.
    """
    return Doubt(
        "fiducial-unsure",
        photo_id,
        say(
            "Fiducial {name}, at column {column:.1f}, row {row:.1f}, is a dot, dim, or of no "
            "listed kind: it was taken because it repeats at the other sides or corners, or "
            "points at the middle of its side. Look whether this is its point.",
            name=mark.name,
            column=mark.column,
            row=mark.row,
        ),
        evidence={
            "fiducial": mark.name,
            "column": mark.column,
            "row": mark.row,
            REPEATED: True,
        },
    )


def nothing_found(photo_id: str, marks: int) -> Doubt:
    """The doubt of a scan without any fiducial; of a camera nobody certified, with no `marks`."""
    if not marks:
        return Doubt(
            "fiducials-not-found",
            photo_id,
            "No fiducials could be recognised at the corners or the sides of the picture. Give "
            "fiducials_mm of the camera, or measure them by hand.",
            0.5,
            {"marks": 0},
        )
    return Doubt(
        "fiducials-not-found",
        photo_id,
        say(
            "None of the {marks} fiducials could be found where fiducials_mm puts them. "
            "Check fiducials_mm, frame_mm and scan_pixel_um of the camera, or measure "
            "them by hand.",
            marks=marks,
        ),
        evidence={"marks": marks},
    )


def doubtful_mark(photo_id: str, name: str, place: tuple[float, float], failure: Failure) -> Doubt:
    """The doubt of a mark that is missing or does not stand."""
    column, row = place
    return Doubt(
        "fiducial-doubtful",
        photo_id,
        say(
            "Fiducial {name}, expected near column {column:.0f}, row {row:.0f}, was not "
            "measured: {reason} Measure it by hand if it is there.",
            name=name,
            column=column,
            row=row,
            reason=failure.reason,
        ),
        evidence={"fiducial": name, "column": column, "row": row, **failure.evidence},
    )


def doubts_of_fit(
    photo_id: str,
    interior: InteriorOrientation,
    marks: Sequence[FiducialMeasurement],
    pixel_mm: float,
) -> tuple[Doubt, ...]:
    """Marks left out, large residuals, no redundancy, odd scale, irregular film, the wrong side.

    Args:
        photo_id: The photo.
        interior: Its interior orientation.
        marks: All marks that were measured.
        pixel_mm: Nominal size of a scan pixel, millimetres.
    """
    return (*_of_marks(photo_id, interior, marks), *_of_film(photo_id, interior, pixel_mm))


def names_guessed(photo_id: str, way: Way) -> Doubt:
    """The doubt of a scan whose marks fit their certificate in several ways to lie."""
    words = "upright" if way == UPRIGHT else turned_words(way)
    return Doubt(
        "fiducial-names",
        photo_id,
        say(
            "The certificate hardly tells which fiducial is which: the marks fit it in "
            "several ways, and the scan was taken to be {words}. Compare it with its "
            "neighbours, or give the camera's data_strip.",
            words=words,
        ),
        evidence={"quarter_turns": way[0], "mirrored": way[1]},
    )


def _of_marks(
    photo_id: str, interior: InteriorOrientation, marks: Sequence[FiducialMeasurement]
) -> Iterator[Doubt]:
    """Whether the marks carry the fit."""
    left_out = [mark.name for mark in marks if mark.name not in interior.names]
    if left_out:
        yield Doubt(
            "fiducial-left-out",
            photo_id,
            say(
                "Fiducial {names} does not lie where the others put it and was left out. "
                "Look whether it is the mark, and whether its certified place is right.",
                names=", ".join(left_out),
            ),
            evidence={"fiducials": left_out},
        )
    if len(interior.names) < 3:
        yield Doubt(
            "fiducials-few",
            photo_id,
            "Only two fiducials were measured: nothing checks them. Measure a third by hand.",
            evidence={"fiducials": list(interior.names)},
        )
    if interior.rms_um > limit_um(interior.pixel_size_mm) / 2:
        yield Doubt(
            "fiducial-residual",
            photo_id,
            say(
                "The fiducials fit their certificate with {rms_um:.0f} µm RMS, more than "
                "their measurement explains.",
                rms_um=interior.rms_um,
            ),
            evidence={"rms_um": interior.rms_um, "chance": interior.chance},
        )


def _of_film(photo_id: str, interior: InteriorOrientation, pixel_mm: float) -> Iterator[Doubt]:
    """Whether the film looks like one of this camera."""
    if interior.mirrored:
        yield Doubt(
            "scan-mirrored",
            photo_id,
            "The film was scanned from its back: its marks lie as in a mirror. The interior "
            "orientation takes that up, but matching wants it the right way round: mirror the "
            "scan, or scan the film again.",
            evidence={"model": interior.model},
        )
    scale = interior.pixel_size_mm / pixel_mm - 1
    if abs(scale) > SCALE_OFF:
        yield Doubt(
            "fiducials-scale",
            photo_id,
            say(
                "The fiducials lie {share:.2f} % too {how} for scan_pixel_um: a print, a "
                "wrong scan_pixel_um, or another camera.",
                share=abs(100 * scale),
                how="close" if scale > 0 else "far apart",
            ),
            evidence={"scale": scale},
        )
    singular = np.linalg.svd(interior.film_from_pixel_matrix[:, :2], compute_uv=False)
    affinity = float(singular[0] / singular[1] - 1)
    if interior.model != "similarity" and affinity > AFFINITY:
        yield Doubt(
            "film-shrinkage",
            photo_id,
            say(
                "The film or the scanner is not true to shape: scales differ by "
                "{affinity:.1e}. The affine interior orientation takes this up.",
                affinity=affinity,
            ),
            evidence={"affinity": affinity},
        )
