"""The only folder that knows viser."""
