"""Stage scans: picture area, fiducials, interior orientation."""
