"""How a process tells the supervisor what has ended one of its participants."""

import traceback

from gslcosim.bus.port import Bus
from gslcosim.machine import fault_text
from gslcosim.runtime.over_bus import control


def tell_fault(bus: Bus, participant: str, error: Exception, *, tick: int) -> None:
    """Tell the supervisor what has ended a participant."""
    text = fault_text(error, "".join(traceback.format_exception(error)))
    note = control.FaultNote(participant=participant, tick=tick, text=text[-control.MAX_TEXT :])
    bus.publish(control.FAULT, note.to_bytes(), urgent=True)
