"""What agents of a run that goes on at a snapshot are told before it begins: all that came before."""

from collections.abc import Iterator, Mapping

from gslcosim.contract import codec
from gslcosim.runtime.agents.bus_link import BusLink
from gslcosim.runtime.over_bus.door_host import DoorHost
from gslcosim.runtime.participants import services_of
from gslcosim.runtime.setup import Setup


def tell_past(setup: Setup, doors: Mapping[str, DoorHost], links: Mapping[str, BusLink]) -> Iterator[None]:
    """Brief all agents, tell them tick by tick what they were told before the snapshot, and wait for their answers.

    Sensing briefs them in the same words when it goes on; that is a repetition.

    Args:
        setup: The run.
        doors: The agents' doors, by agent.
        links: Those of agents on the bus, by agent, to whom sensing writes otherwise.

    Yields:
        Whenever somebody owes an answer, so that it can be heard.
    """
    snapshot, scenario = setup.snapshot, setup.scenario
    if snapshot is None:
        return
    for link in links.values():
        link.is_writer = True
    for kind in services_of(scenario):
        if kind.build_briefings is not None:
            for agent, briefing in kind.build_briefings(setup).items():
                doors[agent].brief(codec.encode(briefing))
    for told in snapshot.told():
        for agent, payload in told:
            doors[agent].observe(payload)
        while any(door.desk.owes_answer for door in doors.values()):
            yield
    for link in links.values():
        link.is_writer = False
