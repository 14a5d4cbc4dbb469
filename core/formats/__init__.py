"""One file per foreign format, with its pixel convention."""
