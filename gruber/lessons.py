"""Lessons in a notebook: sliders as keywords, figures and curves as numbers."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from app.found_lessons import find_lessons
from app.lessons.sheet import Lesson, View
from app.teaching import state_of
from core.errors import PhotogrammetryError

Points = Float64[np.ndarray, "points 2"]


def lesson(name: str) -> "Study":
    """One of the lessons of `gruber teach`, by its name.

    Raises:
        PhotogrammetryError: There is no such lesson.
    """
    found = find_lessons()
    if name not in found:
        raise PhotogrammetryError(name, "is no lesson.", f"There are: {', '.join(found)}.")
    return Study(found[name])


@dataclass(frozen=True, slots=True)
class Study:
    """A lesson; sliders that are not given stand where the page opens."""

    lesson: Lesson
    """What the page shows."""

    def __repr__(self) -> str:
        """Name and sliders, with range, start and unit."""
        sliders = (
            f"  {one.name}: {one.low:g} to {one.high:g}, {one.start:g} {one.unit}".rstrip()
            for one in self.lesson.sliders
        )
        return "\n".join([f"<lesson {self.lesson.name}>", *sliders])

    def view(self, **sliders: float) -> View:
        """All that the page shows: figures, drawings, symbols, plot.

        Raises:
            PhotogrammetryError: No such slider, or a value it cannot have.
        """
        # Numbers of arrays are taken, too.
        plain = {name: float(value) for name, value in sliders.items()}
        return self.lesson.view(state_of(self.lesson, plain))

    def figures(self, **sliders: float) -> dict[str, float]:
        """The figures by name, each in the unit that the page writes behind it."""
        return {name: one.value for name, one in self.view(**sliders).figures.items()}

    def truth(self, **sliders: float) -> dict[str, float]:
        """What was put in, of those figures that are estimates of it."""
        figures = self.view(**sliders).figures
        return {name: one.truth for name, one in figures.items() if one.truth is not None}

    def curves(self, **sliders: float) -> dict[str, Points]:
        """The curves of the plot by name; none where the lesson has no plot now."""
        plot = self.view(**sliders).plot
        return {one.name: np.array(one.points) for one in plot.curves} if plot else {}
