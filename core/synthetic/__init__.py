"""A flight with known truth."""
