"""Information-driven search: expected gain of a stop, and planning over beliefs."""
