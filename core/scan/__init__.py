"""One piece of film."""
