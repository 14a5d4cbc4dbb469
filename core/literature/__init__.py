"""Published chains, methods and operators, for comparison and lessons."""
