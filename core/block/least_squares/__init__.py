"""The estimation itself: equations, solver, reliability, what a decision would change."""
