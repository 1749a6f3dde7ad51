"""Messages about the environment: events that begin, wind, rates of sources, probes; no agent reads them."""

from typing import Annotated

from pydantic import Field

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import GasAmount
from gslcosim.contract.record import Message, Name, Record

EVENTS = "truth/events"
"""The port of `EventsBeginning`."""
WIND = "truth/wind"
"""The port of `WindShare`."""
PROBES = "truth/probes"
"""The port of `ProbeSamples`."""


class EventsBeginning(Message):
    """The events that take effect from the next tick on, most often none. Written on `truth/events` every tick.

    `beginning` holds their indices in the scenario's list `events`, in its order.
    """

    beginning: tuple[int, ...] = ()


class WindShare(Message):
    """The wind as a fraction of the environment's own, from the next tick on. Written on `truth/wind` every tick.

    1 is the wind as it was generated, 0 still air. All of the room's air follows at once: the flow keeps its shape, as
    it does at high Reynolds numbers where only the inlet's speed changes. The response time of a room, minutes for a
    slow change of air, is left out; a service may change the fraction gradually.
    """

    share: Annotated[float, Field(ge=0)]


def build_source_port(i_source: int) -> str:
    """Return the port of the `SourceRate` of a source, by its index in `gas.sources`."""
    return f"truth/sources/{i_source}"


class SourceRate(Message):
    """The mean rate at which a source releases, from the next tick on. Written on `truth/sources/<index>` every tick.

    It replaces `filaments_per_s` of the scenario, in the same unit; 0 is a source that releases nothing.
    """

    filaments_per_s: Annotated[float, Field(ge=0)]


class ProbeSample(Record):
    """True gas and wind at a probe, a point at rest; part of `ProbeSamples`."""

    probe: Name
    gases: tuple[GasAmount, ...]
    wind_world_m_s: Vec3


class ProbeSamples(Message):
    """True gas and wind at the scenario's `probes`, in its order. Written by fields on `truth/probes` every tick.

    Only in runs with probes. Since 1.1.
    """

    samples: tuple[ProbeSample, ...]
