"""Every text of the desk: one table for each language, and the module that reads them."""
