"""Keys of ports under a run's namespace, and the table of their messages, writers, readers and times."""

from dataclasses import dataclass
from typing import Literal

BODIES = "truth/bodies"
SAMPLES = "truth/samples"
FILAMENTS = "truth/filaments"
RADIO = "truth/radio"
IMAGES = "truth/images"
SCORE = "referee/score"
VERDICT = "referee/verdict"
# Stands for an agent's name in a key.
AGENT_PLACEHOLDER = "<agent>"


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


@dataclass(frozen=True)
class KeyEntry:
    """One key of a run, relative to its namespace, and the message that travels on it.

    `direction` is seen from an agent; None where agents take no part. `express` is the set of messages that Zenoh sends
    at once instead of waiting for more to put into the same packet; `asked` are those that await a command. `travels`
    is `alone` where each message has its own packet, else messages of one writer may be bundled.
    """

    key: str
    message: str
    writer: str
    readers: str
    when: str
    direction: Literal["to agent", "from agent"] | None = None
    express: Literal["always", "asked", "never"] = "never"
    travels: Literal["alone", "in bundles up to 4096 bytes"] = "in bundles up to 4096 bytes"


# Key, message, writer, readers, when; further arguments where they differ from the default.
KEY_TABLE = (
    KeyEntry(BODIES, "BodyPoses", "world", "fields, sensing, radio, cameras, referee, recorder", "every tick"),
    KeyEntry(SAMPLES, "FieldSamples", "fields", "sensing, referee, recorder", "every tick"),
    KeyEntry(FILAMENTS, "FilamentCloud", "fields", "recorder", "every `recording.gas_every_s`"),
    KeyEntry(RADIO, "RadioTraffic", "radio", "sensing, recorder", "every tick, in runs with channels"),
    KeyEntry(IMAGES, "CameraFrames", "cameras", "sensing", "every tick, in runs with cameras"),
    KeyEntry(
        briefing(AGENT_PLACEHOLDER), "Briefing", "sensing", "that agent",
        "once, before tick 0; again with a repeated observation",
        direction="to agent", travels="alone",
    ),
    KeyEntry(
        observation(AGENT_PLACEHOLDER), "Observation", "sensing", "that agent, its door, recorder",
        "every tick; again after 1 s without the command it awaits",
        direction="to agent", express="asked", travels="alone",
    ),
    KeyEntry(
        question(AGENT_PLACEHOLDER), "Observation", "sensing",
        "that agent, in place of all observations, if it only looks when it is asked",
        "where an observation awaits a command; again after 1 s without it",
        direction="to agent", express="always", travels="alone",
    ),
    KeyEntry(
        raw_command(AGENT_PLACEHOLDER), "Command", "that agent", "its door",
        "once for each observation that awaits a command",
        direction="from agent", express="always", travels="alone",
    ),
    KeyEntry(
        ending(AGENT_PLACEHOLDER), "Ending", "the supervisor", "that agent", "once, at the end of the run",
        direction="to agent", express="always", travels="alone",
    ),
    KeyEntry(
        command(AGENT_PLACEHOLDER), "Command", "the agent's door", "world, radio, referee, recorder",
        "once for each observation that awaits a command",
        express="always", travels="alone",
    ),
    KeyEntry(SCORE, "Score", "referee", "recorder", "every tick"),
    KeyEntry(VERDICT, "Verdict", "referee", "recorder, the supervisor", "once, at the last tick"),
)  # fmt: skip
