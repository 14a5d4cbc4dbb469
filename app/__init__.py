"""The front door: knows every room, and no photogrammetry."""
