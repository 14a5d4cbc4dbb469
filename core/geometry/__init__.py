"""One photo, one point, one ray."""
