"""What travels on each key: which message, who writes and reads it, when, and how Zenoh carries it."""

from dataclasses import dataclass
from typing import Literal

from gslcosim.contract import keys

# Stands for an agent's name in a key.
AGENT = "<agent>"


@dataclass(frozen=True, kw_only=True)
class Channel:
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


CHANNELS = (
    Channel(
        key=keys.BODIES,
        message="BodyPoses",
        writer="world",
        readers="fields, sensing, radio, cameras, referee, recorder",
        when="every tick",
    ),
    Channel(
        key=keys.SAMPLES,
        message="FieldSamples",
        writer="fields",
        readers="sensing, referee, recorder",
        when="every tick",
    ),
    Channel(
        key=keys.FILAMENTS,
        message="FilamentCloud",
        writer="fields",
        readers="recorder",
        when="every `recording.gas_every_s`",
    ),
    Channel(
        key=keys.RADIO,
        message="RadioTraffic",
        writer="radio",
        readers="sensing, recorder",
        when="every tick, in runs with channels",
    ),
    Channel(
        key=keys.IMAGES,
        message="CameraFrames",
        writer="cameras",
        readers="sensing",
        when="every tick, in runs with cameras",
    ),
    Channel(
        key=keys.briefing(AGENT),
        message="Briefing",
        writer="sensing",
        readers="that agent",
        when="once, before tick 0; again with a repeated observation",
        direction="to agent",
        travels="alone",
    ),
    Channel(
        key=keys.observation(AGENT),
        message="Observation",
        writer="sensing",
        readers="that agent, its door, recorder",
        when="every tick; again after 1 s without the command it awaits",
        direction="to agent",
        express="asked",
        travels="alone",
    ),
    Channel(
        key=keys.question(AGENT),
        message="Observation",
        writer="sensing",
        readers="that agent, in place of all observations, if it only looks when it is asked",
        when="where an observation awaits a command; again after 1 s without it",
        direction="to agent",
        express="always",
        travels="alone",
    ),
    Channel(
        key=keys.raw_command(AGENT),
        message="Command",
        writer="that agent",
        readers="its door",
        when="once for each observation that awaits a command",
        direction="from agent",
        express="always",
        travels="alone",
    ),
    Channel(
        key=keys.ending(AGENT),
        message="Ending",
        writer="the supervisor",
        readers="that agent",
        when="once, at the end of the run",
        direction="to agent",
        express="always",
        travels="alone",
    ),
    Channel(
        key=keys.command(AGENT),
        message="Command",
        writer="the agent's door",
        readers="world, radio, referee, recorder",
        when="once for each observation that awaits a command",
        express="always",
        travels="alone",
    ),
    Channel(key=keys.SCORE, message="Score", writer="referee", readers="recorder", when="every tick"),
    Channel(
        key=keys.VERDICT,
        message="Verdict",
        writer="referee",
        readers="recorder, the supervisor",
        when="once, at the last tick",
    ),
)
