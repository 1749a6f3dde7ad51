"""What a participant of the user's own declares: its dataflow, and what is wrong with it beside its own block."""

from collections.abc import Iterable, Iterator, Sequence

from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.contract.participation import VENTILATION, ParticipantValues
from gslcosim.contract.ventilation import WindShare
from gslcosim.runtime.dataflow import ONCE, cycle_without_delay, port_problems
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.own_models import OwnModelSpec
from gslcosim.scenario.problems import Problem
from gslcosim.scenario.suggestions import did_you_mean
from gslcosim.ticks import ticks_from_seconds

# Names of processes and of who is at fault in a run, beside those of services.
_TAKEN = ("supervisor", "runtime", "fork_server")
_OF_DOORS = "agent_"


def period_ticks_of(own: OwnModelSpec, scenario: Scenario) -> int:
    """Return every how many ticks a participant steps."""
    return 1 if own.period_s is None else max(1, ticks_from_seconds(own.period_s, scenario.tick_ns))


def foreign_spec(own: OwnModelSpec, scenario: Scenario) -> ParticipantSpec:
    """Return the dataflow of a participant; the wind that it sets is there every tick, also between its steps."""
    period_ticks = period_ticks_of(own, scenario)
    return ParticipantSpec(
        name=own.name,
        reads=tuple(Read(port=read.port, delay_ticks=read.delay) for read in own.reads),
        writes=tuple(
            Write(port=own.port_of(word), message_type=WindShare)
            if word == VENTILATION
            else Write(port=own.port_of(word), message_type=ParticipantValues, period_ticks=period_ticks)
            for word in own.writes
        ),
    )


def problems_of_participants(
    scenario: Scenario, services: Sequence[str], specs: Sequence[ParticipantSpec]
) -> Iterable[Problem]:
    """Return what is wrong with the participants of a scenario in the run that it makes.

    Args:
        scenario: The scenario.
        services: The names of all services that there are, whether the run has them or not.
        specs: All participants of the run, doors of agents and these among them.
    """
    found = [*_taken_names(scenario, services), *_unknown_ports(scenario, specs)]
    if found:
        return found
    if problems := [*port_problems(specs)]:
        where, _, rest = problems[0].partition(": expected ")
        expected, _, was = rest.rstrip(".").rpartition(", ")
        return [Problem(path="participants", expected=f"{expected} ({where})", found=was.removeprefix("was "))]
    if cycle := cycle_without_delay(specs):
        ring = " → ".join([*cycle, cycle[0]])
        expected = "a delay of at least 1 tick on one of the reads in each ring"
        return [Problem(path="participants", expected=expected, found=ring, remedy="Add delay: 1 to one of them.")]
    return []


def _taken_names(scenario: Scenario, services: Sequence[str]) -> Iterator[Problem]:
    others = [service.name for service in scenario.services]
    for i, own in enumerate(scenario.participants):
        if own.name in (*services, *others, *_TAKEN) or own.name.startswith(_OF_DOORS):
            yield Problem(
                path=f"participants[{i}].name",
                expected=f"a name that no service has, and that does not begin with {_OF_DOORS}",
                found=f"'{own.name}'",
                remedy=f"For example my_{own.name}.",
            )


def _unknown_ports(scenario: Scenario, specs: Sequence[ParticipantSpec]) -> Iterator[Problem]:
    known = {write.port: write for spec in specs for write in spec.writes if write.announced_in != ONCE}
    for i, own in enumerate(scenario.participants):
        delays = {read.port: read.delay for read in own.reads}
        for j, read in enumerate(own.reads):
            path = f"participants[{i}].reads[{j}].port"
            if read.port not in known:
                expected = f"a port of this run ({', '.join(sorted(known))})"
                remedy = did_you_mean(read.port, known)
                yield Problem(path=path, expected=expected, found=f"'{read.port}'", remedy=remedy)
                continue
            announcer = known[read.port].announced_in
            if announcer is not None and delays.get(announcer, read.delay + 1) > read.delay:
                yield Problem(
                    path=path,
                    expected=f"{announcer}, which announces {read.port}, among the reads with a delay of at most "
                    f"{read.delay}",
                    found=f"a delay of {delays[announcer]}" if announcer in delays else "none",
                    remedy=f"Add {{port: {announcer}, delay: {read.delay}}}.",
                )
