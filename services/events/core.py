"""Events core: evaluates times and conditions of a scenario's events and announces those that begin."""

from typing import cast

from gslcosim.base.errors import ModelError
from gslcosim.base.scalar_kernels import distance
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.messages import BodyPoses, FieldSamples
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.contract.participant_messages import ParticipantValues
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import TriggerSpec
from gslcosim_services.events.ports import events_spec


class EventsCore:
    """Core that evaluates times and conditions of events, and writes `truth/events` every tick.

    An event at a time takes effect in the tick that ends at that time. A condition that holds at the end of tick k
    takes effect in tick k + 1, or `delay_s` later. Messages of step k take effect in tick k + 1: all readers have a
    delay of one tick. A value of a participant holds from its step until its next.

    State: the events of each later tick, as far as they are known, and those whose conditions hold. It draws no random
    numbers.
    Raises ModelError when the truth lacks an agent, or a participant's message a value; the runtime then ends the run
    as invalid.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.spec = events_spec(scenario)
        self._events = scenario.events
        self._gas = scenario.gas.gas
        self._tick_ns = scenario.tick_ns
        self._due: dict[int, list[int]] = {}
        self._held: set[int] = set()

    def reset(self, episode: Episode) -> Outbox:
        """Schedule the events with a time, and no other; no message is written once."""
        del episode
        self._due, self._held = {}, set()
        for i, event in enumerate(self._events):
            if event.at_s is not None:
                self._add(i, max(1, ticks_from_seconds(event.at_s, self._tick_ns)))
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Evaluate the conditions at the end of the tick, and announce the events that begin with the next one."""
        for i, event in enumerate(self._events):
            if event.when is not None and self._begins_to_hold(i, event.when, tick, inbox):
                self._add(i, tick + 1 + ticks_from_seconds(event.when.delay_s, self._tick_ns))
        return {EVENTS: EventsBeginning(tick=tick, beginning=tuple(sorted(self._due.pop(tick + 1, ()))))}

    def _add(self, i_event: int, due_tick: int) -> None:
        self._due.setdefault(due_tick, []).append(i_event)

    # A condition without repetition holds forever once it has held.
    def _begins_to_hold(self, i_event: int, trigger: TriggerSpec, tick: int, inbox: Inbox) -> bool:
        has_held = i_event in self._held
        if has_held and not trigger.repeats:
            return False
        port = trigger.value_port
        if port is not None and port not in inbox:
            return False  # the value is what it was
        holds = self._holds(trigger, tick, inbox) if port is None else self._value_holds(i_event, trigger, tick, inbox)
        if holds:
            self._held.add(i_event)
        else:
            self._held.discard(i_event)
        return holds and not has_held

    def _holds(self, trigger: TriggerSpec, tick: int, inbox: Inbox) -> bool:
        if trigger.within_m is not None and trigger.of_m is not None:
            bodies = cast(BodyPoses, inbox[keys.BODIES]).bodies
            places_m = [body.position_world_m for body in bodies if body.agent == trigger.agent]
            if not places_m:
                raise ModelError(f"events: expected a pose of vehicle {trigger.agent!r} in tick {tick}, was none.")
            return distance(places_m[0], trigger.of_m) <= trigger.within_m
        samples = cast(FieldSamples, inbox[keys.SAMPLES]).samples
        return any(
            gas.mixing_ratio_ppm > (trigger.gas_above_ppm or 0.0)
            for sample in samples
            if sample.agent == trigger.agent
            for gas in sample.gases
            if gas.gas == self._gas
        )

    @staticmethod
    def _value_holds(i_event: int, trigger: TriggerSpec, tick: int, inbox: Inbox) -> bool:
        values = cast(ParticipantValues, inbox[str(trigger.value_port)]).values
        if trigger.value_name not in values:
            raise ModelError(
                f"events[{i_event}].when.value: expected a value that {trigger.participant} writes on "
                f"{trigger.value_port} ({', '.join(sorted(values)) or 'there is none'}), was {trigger.value_name!r}, "
                f"at tick {tick}."
            )
        return trigger.is_met_by(values[trigger.value_name])
