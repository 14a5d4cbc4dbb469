"""Stage: the mosaic cut into map sheets, ready to deliver."""
