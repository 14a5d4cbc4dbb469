"""Stage ties: the same place in several scans."""
