"""`python -m app` is `gruber`."""

import sys

from app.cli import main

sys.exit(main())
