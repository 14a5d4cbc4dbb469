"""What is known of the ground today."""
