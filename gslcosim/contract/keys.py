"""Keys of ports under a run's namespace, and the table of what travels on each, when, and between whom."""

from dataclasses import dataclass
from typing import Literal

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
    """Return the key an agent writes its commands to; only the door reads it."""
    return f"agents/{agent}/command"


def ending(agent: str) -> str:
    """Return the key that tells an agent that the run is over."""
    return f"agents/{agent}/ending"


def command(agent: str) -> str:
    """Return the port of an agent's checked commands, as written by the door."""
    return f"command/{agent}"


# Stands for an agent's name in a key.
AGENT_PLACEHOLDER = "<agent>"


@dataclass(frozen=True, kw_only=True)
class KeyEntry:
    """One key of a run, relative to its namespace, and the message that travels on it.

    `direction` is seen from an agent; None where agents take no part. `express` means that Zenoh sends a message at
    once instead of waiting for more to put into the same packet; `asked` that only those awaiting a command are.
    `travels` says whether each message has its own packet on this key, or may come in a bundle of its writer's.
    """

    key: str
    message: str
    writer: str
    readers: str
    when: str
    direction: Literal["to agent", "from agent"] | None = None
    express: Literal["always", "asked", "never"] = "never"
    travels: Literal["alone", "in bundles up to 4096 bytes"] = "in bundles up to 4096 bytes"


KEY_TABLE = (
    KeyEntry(
        key=BODIES,
        message="BodyPoses",
        writer="world",
        readers="fields, sensing, radio, cameras, referee, recorder",
        when="every tick",
    ),
    KeyEntry(
        key=SAMPLES,
        message="FieldSamples",
        writer="fields",
        readers="sensing, referee, recorder",
        when="every tick",
    ),
    KeyEntry(
        key=FILAMENTS,
        message="FilamentCloud",
        writer="fields",
        readers="recorder",
        when="every `recording.gas_every_s`",
    ),
    KeyEntry(
        key=RADIO,
        message="RadioTraffic",
        writer="radio",
        readers="sensing, recorder",
        when="every tick, in runs with channels",
    ),
    KeyEntry(
        key=IMAGES,
        message="CameraFrames",
        writer="cameras",
        readers="sensing",
        when="every tick, in runs with cameras",
    ),
    KeyEntry(
        key=briefing(AGENT_PLACEHOLDER),
        message="Briefing",
        writer="sensing",
        readers="that agent",
        when="once, before tick 0; again with a repeated observation",
        direction="to agent",
        travels="alone",
    ),
    KeyEntry(
        key=observation(AGENT_PLACEHOLDER),
        message="Observation",
        writer="sensing",
        readers="that agent, its door, recorder",
        when="every tick; again after 1 s without the command it awaits",
        direction="to agent",
        express="asked",
        travels="alone",
    ),
    KeyEntry(
        key=question(AGENT_PLACEHOLDER),
        message="Observation",
        writer="sensing",
        readers="that agent, in place of all observations, if it only looks when it is asked",
        when="where an observation awaits a command; again after 1 s without it",
        direction="to agent",
        express="always",
        travels="alone",
    ),
    KeyEntry(
        key=raw_command(AGENT_PLACEHOLDER),
        message="Command",
        writer="that agent",
        readers="its door",
        when="once for each observation that awaits a command",
        direction="from agent",
        express="always",
        travels="alone",
    ),
    KeyEntry(
        key=ending(AGENT_PLACEHOLDER),
        message="Ending",
        writer="the supervisor",
        readers="that agent",
        when="once, at the end of the run",
        direction="to agent",
        express="always",
        travels="alone",
    ),
    KeyEntry(
        key=command(AGENT_PLACEHOLDER),
        message="Command",
        writer="the agent's door",
        readers="world, radio, referee, recorder",
        when="once for each observation that awaits a command",
        express="always",
        travels="alone",
    ),
    KeyEntry(key=SCORE, message="Score", writer="referee", readers="recorder", when="every tick"),
    KeyEntry(
        key=VERDICT,
        message="Verdict",
        writer="referee",
        readers="recorder, the supervisor",
        when="once, at the last tick",
    ),
)
