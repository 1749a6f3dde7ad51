"""From a scenario to its room, and its places against that room: the only part of environment that reads scenarios."""
