"""The memory: append, replay and find; no screens."""
