"""The methods before the bundle: models, strips, independent models."""
