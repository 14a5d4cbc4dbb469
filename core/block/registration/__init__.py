"""Photos against the reference: patches, operators, search, probability, resection."""
