"""Windows of rasters: scans, sheets of the ortho, heights."""
