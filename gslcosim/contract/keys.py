"""Keys of ports under a run's namespace."""

BODIES = "truth/bodies"
SAMPLES = "truth/samples"
FILAMENTS = "truth/filaments"
RADIO = "truth/radio"
IMAGES = "truth/images"
SCORE = "referee/score"
VERDICT = "referee/verdict"


def briefing(agent: str) -> str:
    """Return the key of an agent's briefing."""
    return f"agents/{agent}/briefing"


def observation(agent: str) -> str:
    """Return the key of an agent's observations."""
    return f"agents/{agent}/observation"


def question(agent: str) -> str:
    """Return the key of those of an agent's observations that await a command."""
    return f"agents/{agent}/question"


def raw_command(agent: str) -> str:
    """Return the key an agent writes its commands to; only the agent's validator reads it."""
    return f"agents/{agent}/command"


def ending(agent: str) -> str:
    """Return the key of the notice to an agent that the run is over."""
    return f"agents/{agent}/ending"


def command(agent: str) -> str:
    """Return the port of an agent's checked commands, written by the agent's validator."""
    return f"command/{agent}"
