"""Stage orthos: one rectified photo each."""
