"""Published chains and methods, for comparison and lessons."""
