"""What an agent asks of its vehicle: the command and its parts."""

from typing import Annotated, Literal, get_args

from pydantic import Field, JsonValue, StringConstraints

from gslcosim.contract.knowledge import Belief
from gslcosim.contract.record import Message, Name, Record
from gslcosim.quantities import Vec3


class RadioMessage(Record):
    """A text that an agent sends on a channel: to the agent named `to`, or to `all` other members of the channel.

    How long it may be in UTF-8 is the channel's `max_bytes`; whether and when it is heard, the channel's business too.
    Part of `Command`. Since contract 1.1.
    """

    channel: Name
    text: Annotated[str, StringConstraints(max_length=65536)]
    to: Name = "all"


class Declaration(Record):
    """Where an agent believes the source to be, and how sure it is (0 to 1)."""

    position_world_m: Vec3
    confidence: Annotated[float, Field(ge=0, le=1)] = 1.0


BodyRate = Annotated[float, Field(ge=-50, le=50)]
Angle = Annotated[float, Field(ge=-6.3, le=6.3)]
HoldTime = Annotated[float, Field(ge=0, le=3600)]


class Waypoint(Record):
    """One place of a mission, part of `Command`. Since contract 1.1.

    Without a velocity the vehicle comes to rest there and holds `hold_s`; with one it passes through with velocity
    `velocity_world_m_s` and acceleration `acceleration_world_m_s2`. It gets there `after_s` after the waypoint before
    (absent: as soon as its limits allow), and looks towards `yaw_rad`, counter-clockwise from world x (absent: as
    before).
    """

    position_world_m: Vec3
    velocity_world_m_s: Vec3 = (0.0, 0.0, 0.0)
    acceleration_world_m_s2: Vec3 = (0.0, 0.0, 0.0)
    hold_s: HoldTime = 0.0
    after_s: Annotated[float, Field(gt=0, le=3600)] | None = None
    yaw_rad: Angle | None = None


class AttitudeSetpoint(Record):
    """Which attitude a multirotor is to take, for an agent with its own control; part of `Command`. Since contract 1.1.

    Roll about body x, pitch about body y, yaw about z, turned in the order yaw, pitch, roll from the world frame.
    `thrust_n` is the thrust of all rotors together; absent: as much as keeps the vertical speed at `climb_m_s`.
    """

    roll_rad: Annotated[float, Field(ge=-3.15, le=3.15)] = 0.0
    pitch_rad: Annotated[float, Field(ge=-3.15, le=3.15)] = 0.0
    yaw_rad: Angle = 0.0
    thrust_n: Annotated[float, Field(ge=0)] | None = None
    climb_m_s: float = 0.0


class RateSetpoint(Record):
    """How fast a multirotor is to turn about its body axes, for an agent with its own control; part of `Command`.

    `thrust_n` and `climb_m_s` are those of `AttitudeSetpoint`. Since contract 1.1.
    """

    rates_body_rad_s: tuple[BodyRate, BodyRate, BodyRate]
    thrust_n: Annotated[float, Field(ge=0)] | None = None
    climb_m_s: float = 0.0


class DriveSetpoint(Record):
    """How a vehicle on wheels is to drive: speed along its nose, and rate of turn to the left; part of `Command`.

    The radius of its circle is `speed_m_s` divided by `yaw_rate_rad_s`. Since contract 1.1.
    """

    speed_m_s: float
    yaw_rate_rad_s: float = 0.0


CommandKind = Literal[
    "waypoint",
    "hold",
    "noop",
    "declare_source",
    "velocity",
    "failed",
    "mission",
    "take_off",
    "land",
    "attitude",
    "rates",
    "drive",
]

# Which field a kind of command cannot do without.
_NEEDED_BY_KIND = {
    "waypoint": "position_world_m",
    "velocity": "velocity_world_m_s",
    "declare_source": "declaration",
    "mission": "waypoints",
    "attitude": "attitude",
    "rates": "rates",
    "drive": "drive",
}


# The same as JSON Schema, so that other languages' validators find it too.
def _needed_by_kind() -> list[JsonValue]:
    return [
        {
            "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
            "then": {"properties": {name: {"not": {"type": "null"}}}, "required": [name]},
        }
        for kind, name in _NEEDED_BY_KIND.items()
    ]


class Command(Message):
    """An agent's answer to the observation of the same `tick`, on `agents/<id>/command`.

    `waypoint` flies to `position_world_m` and holds there `hold_s` (absent: the briefing's);
    `velocity` flies with `velocity_world_m_s` and does not stop for the next command, which is asked for after
    `hold_s`; at the edge of the room the vehicle stops by itself;
    `hold` stays for `hold_s`; `noop` changes nothing; `declare_source` states `declaration` and holds.
    `failed` is written by the runtime in place of an agent that is gone: nothing follows it on this port.
    `contract` (since 1.1) may say in the first command which contract the agent was made for, as `1.1` or `1.1+hash`;
    the door reads it and does not pass it on. `outgoing` (since 1.1) are texts for other agents, sent with a command of
    any kind.
    Since 1.1 also: `mission` flies to all `waypoints` and then asks; `take_off` rises from where it has landed to the
    briefing's search height; `land` comes down, stands and stops its rotors; `attitude` and `rates` leave attitude or
    rates of a multirotor to the agent, and `drive` the speed and turning of a vehicle on wheels: they hold until the
    next command, which is asked for after `hold_s`.
    With `waypoint`, `velocity` and `hold` the vehicle looks towards `yaw_rad`, counter-clockwise from world x, or along
    its path with `faces_path`; with neither it goes on to look where it did.
    `belief` (since 1.2) publishes where the agent believes the source to be, with a command of any kind; at most one a
    second of simulated time is taken.
    """

    kind: CommandKind
    position_world_m: Vec3 | None = None
    hold_s: HoldTime | None = None
    declaration: Declaration | None = None
    reason: Annotated[str, StringConstraints(max_length=500)] = ""
    velocity_world_m_s: Vec3 | None = None
    contract: Annotated[str, StringConstraints(max_length=80)] | None = None
    outgoing: Annotated[tuple[RadioMessage, ...], Field(max_length=16)] = ()
    waypoints: Annotated[tuple[Waypoint, ...], Field(min_length=1, max_length=1000)] | None = None
    attitude: AttitudeSetpoint | None = None
    rates: RateSetpoint | None = None
    drive: DriveSetpoint | None = None
    yaw_rad: Angle | None = None
    faces_path: bool = False
    belief: Belief | None = None

    def check_together(self) -> None:
        """Raise ValueError where what the kind of command cannot do without is missing; see `Record`."""
        needed = _NEEDED_BY_KIND.get(self.kind)
        if needed is not None and getattr(self, needed) is None:
            raise ValueError(f"a {self.kind} command needs {needed}")

    @classmethod
    def json_schema_extra(cls) -> dict[str, JsonValue]:
        """Return the same rule in words of JSON Schema; see `Record`."""
        return {"allOf": _needed_by_kind()}

    @property
    def closes_port(self) -> bool:
        """Whether no further message follows on this port."""
        return self.kind == "failed"


# All kinds that an agent may write; `failed` is the runtime's.
AGENT_KINDS = tuple(kind for kind in get_args(CommandKind) if kind != "failed")
