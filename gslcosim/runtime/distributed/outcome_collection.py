"""Collection of a distributed run's outcome from services and agents: verdict, faults, timing, digest."""

from collections.abc import Mapping

from gslcosim.contract import keys
from gslcosim.contract.messages import Verdict
from gslcosim.runtime.agents.bus_transport import AgentHost
from gslcosim.runtime.agents.validator import collect_faults
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.digest import HashChain, RunDigest
from gslcosim.runtime.distributed.watchdog import RestartPolicy, Watchdog
from gslcosim.runtime.outcome import RunOutcome


def collect_outcome(
    outcome: RunOutcome,
    watchdog: Watchdog,
    hosts: Mapping[str, AgentHost],
    verdict: Verdict | None,
    dataflow: Dataflow,
    restarts: RestartPolicy,
) -> None:
    """Collect into an outcome what services and agents have left: verdict, faults, timing, digest.

    Args:
        outcome: Is added to.
        watchdog: Has the final reports of the services.
        hosts: Of the agents.
        verdict: The run's, if it came to one.
        dataflow: Of the run.
        restarts: Those of services.
    """
    reports = watchdog.final_reports
    outcome.verdict = verdict
    outcome.agent_faults = collect_faults(host.session.validator for host in hosts.values())
    outcome.timing = {name: report.timing for name, report in sorted(reports.items())}
    accounts = (*(report.summary for report in reports.values()), restarts.summary)
    outcome.summary = {key: value for account in accounts for key, value in account.items()}
    outcome.ticks_flown = verdict.tick if verdict else watchdog.finished_tick
    if verdict is None or not watchdog.is_finished:
        return
    trails: dict[str, HashChain] = {}
    for report in reports.values():
        trails |= {port: HashChain.from_fields(fields) for port, fields in report.trails.items()}
    for name, host in hosts.items():
        trails[keys.command(name)] = host.session.trail
    outcome.digest = RunDigest.of(trails, dataflow.writer_of, verdict.tick)
