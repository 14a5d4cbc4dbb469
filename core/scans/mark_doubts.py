"""What is told of marks that are missing or do not stand."""

from core.doubts import Doubt, Failure


def nothing_found(photo_id: str, marks: int) -> Doubt:
    """The doubt of a scan without any fiducial."""
    return Doubt(
        "fiducials-not-found",
        photo_id,
        f"None of the {marks} fiducials could be found where fiducials_mm puts them. Check "
        "fiducials_mm, frame_mm and scan_pixel_um of the camera, or measure them by hand.",
        evidence={"marks": marks},
    )


def no_marks(photo_id: str) -> Doubt:
    """The doubt of a scan in which no marks were recognised, of a camera nobody certified."""
    return Doubt(
        "fiducials-not-found",
        photo_id,
        "No fiducials could be recognised at the corners or the sides of the picture. Give "
        "fiducials_mm of the camera, or measure them by hand.",
        0.5,
        {"marks": 0},
    )


def doubtful_mark(photo_id: str, name: str, place: tuple[float, float], failure: Failure) -> Doubt:
    """The doubt of a mark that is missing or does not stand."""
    column, row = place
    return Doubt(
        "fiducial-doubtful",
        photo_id,
        f"Fiducial {name}, expected near column {column:.0f}, row {row:.0f}, was not measured: "
        f"{failure.reason} Measure it by hand if it is there.",
        evidence={"fiducial": name, "column": column, "row": row, **failure.evidence},
    )


def unsure_mark(photo_id: str, name: str, place: tuple[float, float], sigma_px: float) -> Doubt:
    """The doubt of a mark that stands, but not firmly."""
    column, row = place
    return Doubt(
        "fiducial-unsure",
        photo_id,
        f"Fiducial {name}, at column {column:.1f}, row {row:.1f}, is only known to "
        f"{sigma_px:.2f} pixels: dirt, a scratch or a blurred mark. Look at it.",
        evidence={"fiducial": name, "column": column, "row": row, "sigma_px": sigma_px},
    )
