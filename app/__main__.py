"""`python -m app` is `gruber`."""

from app.cli import program

program()
