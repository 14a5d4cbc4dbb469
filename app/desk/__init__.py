"""The review desk: what it works on, the loop that owns it, the work beside it."""
