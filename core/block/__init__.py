"""Many photos become one block."""
