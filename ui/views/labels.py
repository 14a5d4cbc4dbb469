"""Names in the scene; each is made when it is first asked for, for names are the slowest."""

from collections.abc import Mapping

import numpy as np
import viser

from core.arrays import Position

LABELS = "/labels"
"""Above the names of the photos."""


def plain_name(name: str) -> str:
    """A name without the separator of the scene tree."""
    return name.replace("/", "_")


def label_node(name: str, above: str = LABELS) -> str:
    """Node of one name."""
    return f"{above}/{plain_name(name)}"


def names_apart(places: Mapping[str, Position], apart_m: float) -> dict[str, Position]:
    """Names where they can be read: those nearer than a distance become one, at their mean."""
    groups: list[list[str]] = []
    for name, place in places.items():
        near = next((g for g in groups if np.linalg.norm(places[g[0]] - place) < apart_m), None)
        if near is None:
            groups.append([name])
        else:
            near.append(name)
    return {" ".join(group): np.mean([places[name] for name in group], axis=0) for group in groups}


class Labels:
    """Names of one kind."""

    def __init__(self, scene: viser.SceneApi, above: str) -> None:
        self._scene, self._above = scene, above
        self._shown: dict[str, tuple[list[float], viser.LabelHandle]] = {}

    def show(self, places: Mapping[str, Position], visible: bool) -> None:
        """These names and no others."""
        for name, (_, label) in self._shown.items():
            label.visible = visible and name in places
        for name, position in places.items() if visible else ():
            old = self._shown.get(name)
            if old is not None and old[0] == position.tolist():
                continue
            if old is not None:
                old[1].remove()
            label = self._scene.add_label(
                label_node(name, self._above), name, position=position, font_screen_scale=0.85
            )
            self._shown[name] = position.tolist(), label
