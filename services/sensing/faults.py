"""Faults of sensors by events: they drop out, stick, drift, are biased, and recover."""

from dataclasses import dataclass

from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract.messages import Reading
from gslcosim.contract.participant import Inbox
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import find_due_events
from gslcosim.scenario.models.events import (
    SensorBiasedSpec,
    SensorDriftsSpec,
    SensorDropsOutSpec,
    SensorEventSpec,
    SensorRecoversSpec,
    SensorSticksSpec,
)
from gslcosim_services.sensing.sensor_descriptions import find_sensor_kind

_Key = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class _Fault:
    event: SensorEventSpec
    since_tick: int


class SensorFaults:
    """Faults of all sensors of a run; the instruments behind them continue as if there were none.

    A drifting or biased value v becomes v + bias + drift_per_s t, t the time since the event, and never falls below
    the least value of its kind of sensor; values that have no errors of an instrument, such as a direction behind a
    speed, stay as they are.

    State: the last event of each sensor that has one, and the reading that it showed before.
    Held by: tests/unit/services/sensing/test_faults.py
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._faults: dict[_Key, _Fault] = {}
        self._models = {
            (agent.name, sensor.name): sensor.model for agent in scenario.agents for sensor in agent.sensors
        }

    def reset(self) -> None:
        """Clear all faults."""
        self._faults = {}

    def obey(self, tick: int, inbox: Inbox) -> None:
        """Apply what takes effect in this tick."""
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, SensorRecoversSpec):
                self._faults.pop((event.agent, event.sensor), None)
            elif isinstance(event, SensorEventSpec):
                self._faults[event.agent, event.sensor] = _Fault(event=event, since_tick=tick)

    def shown(self, agent: str, reading: Reading, before: Reading | None, tick: int) -> Reading:
        """Return the reading that a sensor shows at the end of a tick.

        Args:
            agent: Whose sensor.
            reading: What it would show.
            before: What it showed a tick ago.
            tick: The tick.
        """
        fault = self._faults.get((agent, reading.sensor))
        if fault is None:
            return reading
        match fault.event:
            case SensorSticksSpec():
                return before or reading
            case SensorDropsOutSpec():
                lost = {"is_warming_up": True, "is_saturated": False, "array": None, "image": None}
                return (before or reading).model_copy(update=lost)
            case SensorBiasedSpec(bias=bias):
                return self._shifted(agent, reading, bias)
            case SensorDriftsSpec(drift_per_s=drift_per_s):
                since_s = seconds_from_ticks(tick - fault.since_tick, self._scenario.tick_ns)
                return self._shifted(agent, reading, drift_per_s * since_s)
            case _:
                return reading

    def _shifted(self, agent: str, reading: Reading, by: float) -> Reading:
        kind = find_sensor_kind(self._scenario, self._models[agent, reading.sensor])
        n = len(reading.values) if kind.n_with_errors is None else kind.n_with_errors
        values = [max(value + by, kind.least_value) for value in reading.values[:n]]
        return reading.model_copy(update={"values": (*values, *reading.values[n:])})
