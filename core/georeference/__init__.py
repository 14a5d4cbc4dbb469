"""Stage georeference: what the archive says of where a photo lies."""
