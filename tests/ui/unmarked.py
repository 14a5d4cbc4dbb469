"""The tiny block with its marks taken away, as a camera that nobody knows comes to the desk."""

from collections.abc import Mapping
from dataclasses import replace

from app.desk.inputs import DeskInputs
from core.geometry.interior import nominal_interior
from core.scans.interior_orientation import ScanOrientation
from core.scans.judging import FiducialMeasurement, FiducialSet

PLACES = {"1": "L", "2": "R", "3": "T", "4": "B"}
"""Where in the scan the marks of the tiny block lie."""


def without_marks(inputs: DeskInputs, certified: bool = False) -> DeskInputs:
    """Nothing was found, and unless `certified` nobody knows where marks lie."""
    block, films = inputs.block, dict[str, ScanOrientation]()
    cameras = {
        name: camera if certified else replace(camera, fiducials_mm={})
        for name, camera in block.cameras.items()
    }
    for name, film in inputs.initial.films.items():
        pixel_mm = inputs.initial.pixel_mm[name]
        camera = cameras[block.photos[name].camera]
        interior = nominal_interior(film.size_px, camera, pixel_mm)
        films[name] = replace(film, interior=interior, fiducials=(), doubts=())
    photos = {
        name: replace(photo, interior=films[name].interior) for name, photo in block.photos.items()
    }
    initial = replace(inputs.initial, films=films, cameras=cameras)
    block = replace(block, cameras=cameras, photos=photos)
    report = replace(inputs.report, block=replace(inputs.report.block, cameras=cameras))
    return replace(inputs, block=block, initial=initial, report=report)


def as_found(films: Mapping[str, ScanOrientation], named: bool = False) -> dict[str, FiducialSet]:
    """The marks that the run found, named by where they lie unless `named` by the certificate."""

    def shown(mark: FiducialMeasurement) -> FiducialMeasurement:
        return mark if named else replace(mark, name=PLACES[mark.name])

    return {
        name: FiducialSet(tuple(shown(mark) for mark in film.fiducials), (), film.way)
        for name, film in films.items()
    }
