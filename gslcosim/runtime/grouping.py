"""Which services share a process: a choice of deployment, without influence on results."""

from collections.abc import Sequence

from gslcosim.errors import UsageError
from gslcosim.scenario.models.scenario import Processes

Group = tuple[str, ...]


def groups_of(processes: Processes, services: Sequence[str]) -> tuple[Group, ...]:
    """Return the services of each process of a run, both from upstream to downstream.

    Args:
        processes: `separate`, `grouped`, or lists of services that share a process; the rest are then separate.
        services: Those of the run, from upstream to downstream.

    Raises:
        UsageError: a list names what is no service of the run, or one twice.
    """
    if processes == "separate":
        return tuple((name,) for name in services)
    if processes in ("grouped", "one"):
        return (tuple(services),)
    named = [name for group in processes for name in group]
    wrong = [name for name in named if name not in services or named.count(name) > 1]
    if wrong:
        raise UsageError(
            f"processes: expected each service at most once, of {', '.join(services)}, was {wrong[0]!r}"
            f"{', twice' if wrong[0] in services else ''}."
        )
    groups = [tuple(sorted(group, key=services.index)) for group in processes if group]
    groups += [(name,) for name in services if name not in named]
    return tuple(sorted(groups, key=lambda group: services.index(group[0])))


def process_name(group: Group) -> str:
    """Return the name of the process of a group, which is that of its log too."""
    return "+".join(group)
