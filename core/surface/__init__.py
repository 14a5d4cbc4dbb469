"""Stage surface: heights of the ground and what stands on it, from the photos themselves."""
