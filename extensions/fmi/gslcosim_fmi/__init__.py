"""Units of FMI 2 and 3 as participants.

`description` reads a unit, `wiring` connects it with a scenario, `checks` says what does not fit, `core` stands for it
in a run, and `host` loads it in a process of its own.
"""
