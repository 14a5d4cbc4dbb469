"""Names of the nodes of the 3D scene, shared by the views and by the tests that look for them."""

from ui.review.palette import ShownState

TERRAIN = "/terrain"
FOOTPRINTS = "/footprints"
VECTORS = "/vectors"
CHECKS = "/checks"
TIES = "/ties"
TIE_VECTORS = "/tie_vectors"
CURRENT = "/current"
CURRENT_RAY = "/current_ray"


def photo_node(photo_id: str) -> str:
    """Frustum of one photo."""
    return f"/photos/{_plain(photo_id)}"


def points_node(state: ShownState) -> str:
    """Cloud of the control points in one state."""
    return f"/points/{state}"


def label_node(point_id: str) -> str:
    """Name of a surveyed point."""
    return f"/labels/{_plain(point_id)}"


def _plain(name: str) -> str:
    """A name without the separator of the scene tree."""
    return name.replace("/", "_")
