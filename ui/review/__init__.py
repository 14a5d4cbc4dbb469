"""What is shown and what a gesture means; knows nothing of viser."""
