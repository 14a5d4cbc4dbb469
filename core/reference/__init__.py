"""Stage reference: junctions and salient points of the ground."""
