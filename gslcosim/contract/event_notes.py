"""What the runtime's own participants are told of a scenario's events; agents cannot read it."""

from gslcosim.contract.record import Message

EVENTS = "truth/events"
"""The port of `EventsBeginning`."""


class EventsBeginning(Message):
    """The events that take effect from the next tick on, most often none. Written on `truth/events` every tick.

    Each is its place in the scenario's list `events`, from 0 on, in that order.
    """

    beginning: tuple[int, ...] = ()
