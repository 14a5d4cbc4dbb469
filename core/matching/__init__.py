"""One patch sought in a picture: operators, peaks, probability."""
