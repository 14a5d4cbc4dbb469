"""Stage adjustment: the least-squares estimation and its statistics."""
