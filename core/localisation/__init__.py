"""Stage localisation: where the photos really lie, together."""
