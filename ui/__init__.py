"""The window: shows and asks; never computes geometry, never saves."""
