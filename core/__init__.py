"""The engine: takes arrays and values, returns values; no screen, no session, no globals."""
