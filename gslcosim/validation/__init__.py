"""Our physics and methods beside measurements."""
