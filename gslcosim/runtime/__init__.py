"""Runtime: hosts cores in one process or behind a bus, and supervises; the only code that waits or reads a clock."""
