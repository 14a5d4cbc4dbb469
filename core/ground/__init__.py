"""The block becomes ground: orthos and mosaic."""
