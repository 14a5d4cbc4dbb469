"""Tie points: features, matches, chains of rays, fine measurement."""
