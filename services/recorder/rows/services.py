"""Rows of services of other packages and of participants: a curve for each number and truth value."""

from collections.abc import Iterable, Sequence

from gslcosim.contract.environment_messages import WIND
from gslcosim.contract.participant import Inbox
from gslcosim.contract.participant_messages import ParticipantValues
from gslcosim.contract.record import Message
from gslcosim.scenario import Scenario
from gslcosim_services.recorder import entities
from gslcosim_services.recorder.rows.columns import ScalarRows


class ServiceRows:
    """Curves of a run's services, `plots/services/<port>/<field>`; a field is known when it first comes."""

    def __init__(self, scenario: Scenario) -> None:
        wind = (WIND,) if scenario.has_driven_wind else ()
        self._ports = (*wind, *scenario.curve_ports)
        self._rows: dict[str, ScalarRows] = {}

    def add(self, tick: int, inbox: Inbox) -> None:
        """Take note of the messages of a tick."""
        for port in self._ports:
            message = inbox.get(port)
            for name, value in _numeric_fields(message) if message is not None else ():
                if name != "tick" and isinstance(value, bool | int | float):
                    entity = f"{entities.SERVICE_PLOTS}/{port}/{name}"
                    self._rows.setdefault(entity, ScalarRows(entity)).add(tick, float(value))

    def all(self) -> Sequence[ScalarRows]:
        """Return all rows."""
        return tuple(self._rows.values())


def _numeric_fields(message: Message) -> Iterable[tuple[str, object]]:
    return (message.values if isinstance(message, ParticipantValues) else message.model_dump()).items()
