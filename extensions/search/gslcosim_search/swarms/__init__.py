"""Teams: radio, rounds, formations, particle swarms, glowworms."""
