"""Who writes waits for its readers before the first tick: what is sent before they listen is lost."""

from collections.abc import Callable, Iterable

from gslcosim.bus.port import Bus
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.over_bus import control

# Links between services may come up later than those to the router. Who is not there by then asks again for what it has
# missed.
LIMIT_S = 5.0


class AbsentReaders:
    """The services of other processes that read what a process writes, and have not been seen on its own links.

    Args:
        readers: All who read what it writes, in other processes.
        dataflow: Of the whole run.
    """

    def __init__(self, readers: Iterable[str], dataflow: Dataflow) -> None:
        # Agents are told at their doors, which are there already.
        self._names = {name for name in readers if not _is_agent(name, dataflow)}
        self._deadline_s: float | None = None

    def watch(self, bus: Bus, on_came: Callable[[str], None]) -> None:
        """Let `on_came` be told, on any thread, who is there."""
        for name in self._names:
            bus.watch_alive(control.alive(name), lambda _, is_alive, name=name: on_came(name) if is_alive else None)

    def came(self, name: str) -> None:
        """Take note that a reader is there."""
        self._names.discard(name)

    def left_s(self, now_s: float) -> float:
        """Return for how long the rest is still to be waited for [s], from the first call on."""
        if self._deadline_s is None:
            self._deadline_s = now_s + LIMIT_S
        return max(self._deadline_s - now_s, 0.0) if self._names else 0.0


def _is_agent(name: str, dataflow: Dataflow) -> bool:
    return all(control.is_for_agents(read.port) for read in dataflow.by_name[name].reads)
