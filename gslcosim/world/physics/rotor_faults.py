"""What events do to rotors: they give less than the control believes."""

from typing import Any

from gslcosim.contract.participant import Inbox
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import due_events
from gslcosim.scenario.models.event_kinds import RotorWeakensSpec


class RotorFaults:
    """Weakens rotors in the records of `CONSTANTS` of all vehicles, in place.

    A rotor of share s gives s k w^2 at a speed w, and its torques likewise; how thrusts are shared out stays as it was,
    as the control does not know.
    """

    def __init__(self, scenario: Scenario, constants: Any) -> None:
        """Prepare for the events of a scenario.

        Args:
            scenario: Its agents, in the order of the records.
            constants: The records, of sound vehicles.
        """
        self._scenario = scenario
        self._constants = constants
        self._sound = constants["wrench_from_thrusts"].copy()
        self._number = {agent.name: k for k, agent in enumerate(scenario.agents)}

    def reset(self) -> None:
        """All rotors are sound."""
        self._constants["wrench_from_thrusts"] = self._sound

    def obey(self, inbox: Inbox) -> None:
        """Do what takes effect in this tick."""
        for _, event in due_events(self._scenario, inbox):
            if isinstance(event, RotorWeakensSpec):
                k, i = self._number[event.agent], event.rotor
                self._constants["wrench_from_thrusts"][k, :, i] = event.share * self._sound[k, :, i]
