"""Conduct of agents in a run: refused commands, contact with gas, and what their gas sensors could measure.

Referee and sensing count it in their processes and leave it in their summaries (`SupportsSummary`) under the keys here;
`gslcosim.validity.findings` judges it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

CONDUCT_KEY = "conduct"
"""By agent the fields of `AgentConduct` but for its sensors; of the referee."""

SENSOR_STATES_KEY = "sensor_states"
"""By agent and gas sensor the changes that `count_sensor_use` takes; of sensing."""

INTERNAL_KEYS = frozenset({CONDUCT_KEY, SENSOR_STATES_KEY})
"""Keys that `result.json` does not have: findings are made of them."""

# A TGS2600 responds to ethanol from 0.2986 ppm on, (air / A)^(1/B) of its power law: the weakest gas that
# any of the sensors' models distinguishes from clean air.
GAS_CONTACT_PPM = 0.3


@dataclass(frozen=True, kw_only=True)
class SensorUse:
    """Ticks of a run in which a gas sensor was read, was at the end of its range, and did not measure yet."""

    n_ticks: int
    n_saturated: int
    n_warming_up: int


@dataclass(frozen=True, kw_only=True)
class AgentConduct:
    """Conduct of one agent in a run, as referee and instruments have seen it.

    Attributes:
        agent: Its name.
        n_commands: Commands that took effect, until its end.
        n_refused: Of these, those that the vehicle refused or that could not be read.
        n_adjusted: Times that a command was changed or cut short.
        first_refusal: Why, for the first of either.
        gas_contact_s: When one of its sensors was first in true gas above the floor [s]; absent if never.
        has_succeeded: Whether it found the source.
        sensors: Its gas sensors.
    """

    agent: str
    n_commands: int
    n_refused: int = 0
    n_adjusted: int = 0
    first_refusal: str | None = None
    gas_contact_s: float | None = None
    has_succeeded: bool = False
    sensors: Mapping[str, SensorUse] = field(default_factory=dict[str, SensorUse])

    @property
    def refused_frac(self) -> float:
        """Share of its commands that were refused."""
        return self.n_refused / self.n_commands if self.n_commands else 0.0


def read_conduct(summary: Mapping[str, Any], *, n_ticks: int) -> list[AgentConduct]:
    """Return the conduct of all agents from the summaries of referee and sensing; nothing where the referee left none.

    Args:
        summary: Summaries of participants, by key.
        n_ticks: Ticks of the run; what instruments did later does not count.
    """
    states = summary.get(SENSOR_STATES_KEY, {})
    return [
        AgentConduct(
            agent=agent,
            **figures,
            sensors={
                sensor: count_sensor_use(changes, n_ticks=n_ticks) for sensor, changes in states.get(agent, {}).items()
            },
        )
        for agent, figures in summary.get(CONDUCT_KEY, {}).items()
    ]


def count_sensor_use(changes: Sequence[Sequence[Any]], *, n_ticks: int) -> SensorUse:
    """Return how long a sensor was in which state.

    Args:
        changes: (tick, is_saturated, is_warming_up) for each tick at which either changed, the first one included;
            none where the run ended before the sensor's first tick.
        n_ticks: Ticks of the run.
    """
    ends = [*(int(change[0]) for change in changes), n_ticks][1:]
    n_saturated = n_warming_up = 0
    for (tick, is_saturated, is_warming_up), end in zip(changes, ends, strict=True):
        n = max(0, min(end, n_ticks) - int(tick))
        n_saturated += n * bool(is_saturated)
        n_warming_up += n * bool(is_warming_up)
    return SensorUse(n_ticks=n_ticks, n_saturated=n_saturated, n_warming_up=n_warming_up)
