"""The report of a block: one model of figures, and its forms as page, JSON, text and tables."""
