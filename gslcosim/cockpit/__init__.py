"""A person at the place of an agent: sees what it is told on a terminal, and commands with keys."""
