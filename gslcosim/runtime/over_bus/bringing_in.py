"""What a run over the bus has brought in, once its services are done."""

from collections.abc import Mapping

from gslcosim.contract import keys
from gslcosim.contract.messages import Verdict
from gslcosim.runtime.agents.door import faults_of
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.digest import RunDigest, Trail
from gslcosim.runtime.outcome import Outcome
from gslcosim.runtime.over_bus.door_host import DoorHost
from gslcosim.runtime.over_bus.restarts import Restarts
from gslcosim.runtime.over_bus.watchdog import Watchdog


def bring_in(
    outcome: Outcome,
    watchdog: Watchdog,
    doors: Mapping[str, DoorHost],
    verdict: Verdict | None,
    dataflow: Dataflow,
    restarts: Restarts,
) -> None:
    """Add to an outcome what services and agents have left: verdict, faults, timing, digest.

    Args:
        outcome: Is added to.
        watchdog: Has the goodbyes of the services.
        doors: Of the agents.
        verdict: The run's, if it came to one.
        dataflow: Of the run.
        restarts: Those of services.
    """
    byes = watchdog.byes
    outcome.verdict = verdict
    outcome.agent_faults = faults_of(door.desk.door for door in doors.values())
    outcome.timing = {name: bye.timing for name, bye in sorted(byes.items())}
    accounts = (*(bye.account for bye in byes.values()), restarts.account)
    outcome.account = {key: told for account in accounts for key, told in account.items()}
    outcome.ticks_flown = verdict.tick if verdict else watchdog.finished_tick
    if verdict is None or not watchdog.are_done:
        return
    trails: dict[str, Trail] = {}
    for bye in byes.values():
        trails |= {port: Trail.from_fields(fields) for port, fields in bye.trails.items()}
    for name, door in doors.items():
        trails[keys.command(name)] = door.desk.trail
    outcome.digest = RunDigest.of(trails, dataflow.writer_of, verdict.tick)
