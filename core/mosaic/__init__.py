"""Stage mosaic: the composition of the orthos."""
