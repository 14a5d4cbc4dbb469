"""Lessons: one file each, declared as data, computed by the engine's own functions."""
