"""The engine: arrays and values in, values out; no screen, no memory, no globals."""
