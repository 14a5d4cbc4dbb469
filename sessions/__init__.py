"""The memory: appends, replays, finds; knows nothing of screens."""
