"""The command line, the block file and the desk's threads; the only room that knows all others."""
