"""What the desk shows and what gestures mean; does not know viser."""
