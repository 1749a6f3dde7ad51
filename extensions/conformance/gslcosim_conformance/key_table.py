"""Table of the keys of a run: their messages, writers, readers and times."""

from dataclasses import dataclass
from typing import Literal

from gslcosim.contract import keys

# Stands for an agent's name in a key.
AGENT_PLACEHOLDER = "<agent>"


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
    KeyEntry(keys.BODIES, "BodyPoses", "world", "fields, sensing, radio, cameras, referee, recorder", "every tick"),
    KeyEntry(keys.SAMPLES, "FieldSamples", "fields", "sensing, referee, recorder", "every tick"),
    KeyEntry(keys.FILAMENTS, "FilamentCloud", "fields", "recorder", "every `recording.gas_every_s`"),
    KeyEntry(keys.RADIO, "RadioTraffic", "radio", "sensing, recorder", "every tick, in runs with channels"),
    KeyEntry(keys.IMAGES, "CameraFrames", "cameras", "sensing", "every tick, in runs with cameras"),
    KeyEntry(
        keys.briefing(AGENT_PLACEHOLDER), "Briefing", "sensing", "that agent",
        "once, before tick 0; again with a repeated observation",
        direction="to agent", travels="alone",
    ),
    KeyEntry(
        keys.observation(AGENT_PLACEHOLDER), "Observation", "sensing", "that agent, its door, recorder",
        "every tick; again after 1 s without the command it awaits",
        direction="to agent", express="asked", travels="alone",
    ),
    KeyEntry(
        keys.question(AGENT_PLACEHOLDER), "Observation", "sensing",
        "that agent, in place of all observations, if it only looks when it is asked",
        "where an observation awaits a command; again after 1 s without it",
        direction="to agent", express="always", travels="alone",
    ),
    KeyEntry(
        keys.raw_command(AGENT_PLACEHOLDER), "Command", "that agent", "its door",
        "once for each observation that awaits a command",
        direction="from agent", express="always", travels="alone",
    ),
    KeyEntry(
        keys.ending(AGENT_PLACEHOLDER), "Ending", "the supervisor", "that agent", "once, at the end of the run",
        direction="to agent", express="always", travels="alone",
    ),
    KeyEntry(
        keys.command(AGENT_PLACEHOLDER), "Command", "the agent's door", "world, radio, referee, recorder",
        "once for each observation that awaits a command",
        express="always", travels="alone",
    ),
    KeyEntry(keys.SCORE, "Score", "referee", "recorder", "every tick"),
    KeyEntry(keys.VERDICT, "Verdict", "referee", "recorder, the supervisor", "once, at the last tick"),
)  # fmt: skip
