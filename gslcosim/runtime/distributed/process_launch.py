"""Launch of a distributed run: opens the router, starts each service's and agent's process."""

import queue
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path

from gslcosim.base.errors import MachineError, SimulationFault
from gslcosim.base.files import ScratchFolder, append_bytes
from gslcosim.base.processes import Interruption, build_python_command
from gslcosim.bus.interface import JoinData, Mesh
from gslcosim.bus.zenoh_bus import SERVICE_ACCOUNT, AgentAccount, ZenohBus, generate_password, is_mesh_possible
from gslcosim.contract.participant import get_agent_participant
from gslcosim.runtime.agents.gateway_transport import GatewayAgents
from gslcosim.runtime.agents.loader import build_start_command
from gslcosim.runtime.distributed.protocol import Interrupted, ProcessEnded, ProcessStopped, SupervisorEvent
from gslcosim.runtime.distributed.service_main import build_fork_request
from gslcosim.runtime.distributed.supervisor import RunEndedError, Supervisor
from gslcosim.runtime.distributed.watchdog import RestartPolicy
from gslcosim.runtime.network import Network
from gslcosim.runtime.outcome import RunOutcome, ServiceFault
from gslcosim.runtime.processes.child_processes import EXIT_TIMEOUT_S, ChildProcesses
from gslcosim.runtime.processes.current_process import keep_memory_private
from gslcosim.runtime.processes.fork_server import FORK_SERVER, ForkServer
from gslcosim.runtime.processes.sandbox.selection import build_confinement
from gslcosim.runtime.processes.stop_detection import StopMonitor, can_detect_stops
from gslcosim.runtime.remote_server import RunServer
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import ServiceGroup, get_process_name
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunStatus


class RunRouter:
    """Opens the router on a private unix socket, and on what the network adds; passwords are in no file.

    Args:
        run_dir: The run; its id is the namespace.
        crews: The agents of each process that joins the bus, by the process's name.
        mesh: The processes of services on this host, which reach each other past the router.
    """

    def __init__(
        self,
        run_dir: RunDir,
        network: Network,
        socket_dir: Path,
        crews: Mapping[str, tuple[str, ...]],
        mesh: Sequence[str],
    ) -> None:
        self._run_dir = run_dir
        self._network = network
        self._socket_dir = socket_dir
        self._crews = crews
        self.socket = socket_dir / "router.sock"
        meshed = mesh if is_mesh_possible() else ()
        self._mesh_endpoints = {name: f"unixsock-stream/{socket_dir}/{i}.mesh" for i, name in enumerate(meshed)}
        self._endpoint = f"unixsock-stream/{self.socket}"
        self._namespace = f"gsl/{run_dir.run_id}"
        self._service_password = generate_password()
        self._accounts = {
            process: AgentAccount(
                agent=process, password=generate_password(), others=tuple(name for name in agents if name != process)
            )
            for process, agents in crews.items()
        }

    def open(self) -> ZenohBus:
        """Open the router and return the supervisor's own connection."""
        return ZenohBus.open_router(
            endpoints=[self._endpoint, *self._network.listen],
            namespace=self._namespace,
            service_password=self._service_password,
            agents=self._accounts.values(),
            secrets_dir=self._socket_dir,
            tls=self._network.tls,
            lease_s=self._network.lease_s,
        )

    def join_of_service(self, name: str, *, is_watched: bool) -> JoinData:
        """Return how a service joins; `is_watched`: its process is a child of this one."""
        return JoinData(
            name=name,
            endpoint=self._endpoint,
            namespace=self._namespace,
            user=SERVICE_ACCOUNT,
            password=self._service_password,
            run_dir=str(self._run_dir.path.resolve()),
            window_ticks=self._network.window_ticks,
            is_watched=is_watched,
            mesh=self._mesh_of(name),
        )

    # Of any two one calls the other.
    def _mesh_of(self, name: str) -> Mesh | None:
        if name not in self._mesh_endpoints:
            return None
        earlier = takewhile(lambda other: other != name, self._mesh_endpoints)
        return Mesh(listen=self._mesh_endpoints[name], connect=tuple(self._mesh_endpoints[other] for other in earlier))

    def join_of_process(self, process: str, *, is_watched: bool) -> JoinData:
        """Return how a process of agents joins; `is_watched`: it is a child of this one."""
        account, agents = self._accounts[process], self._crews[process]
        return JoinData(
            name=process,
            endpoint=self._endpoint,
            namespace=self._namespace,
            user=account.user,
            password=account.password,
            agents=agents if len(agents) > 1 else None,
            is_watched=is_watched,
        )


def run_distributed(
    setup: RunSetup,
    directory: Path,
    network: Network,
    report: Callable[[RunStatus], None],
    groups: Sequence[ServiceGroup],
    fork_server: ForkServer | None = None,
) -> RunOutcome:
    """Run a scenario as separate processes until the verdict, a fault or an interruption; none is left afterwards."""
    keep_memory_private()
    began = time.perf_counter()
    events: queue.SimpleQueue[SupervisorEvent] = queue.SimpleQueue()
    gateway = GatewayAgents(setup, directory, network, events.put)

    # On the thread that waits for the process.
    def on_exit(name: str, exit_code: int, how: str) -> None:
        if fork_server is not None and fork_server.has_failed:
            name = FORK_SERVER
        if not gateway.exited(name, exit_code, how):
            events.put(ProcessEnded(name, how, is_by_itself=exit_code > 0))

    # On the thread of the watch.
    def on_stopped(name: str) -> None:
        if not gateway.stopped(name):
            events.put(ProcessStopped(name))

    crews = {name: agents for name, agents in setup.scenario.agents_by_process().items() if name not in gateway}
    with ExitStack() as stack:
        socket_dir = stack.enter_context(ScratchFolder.for_sockets()).path
        stack.callback(gateway.close)
        interruption = stack.enter_context(Interruption(lambda: events.put(Interrupted())))
        starts_services = not all(network.is_remote(group[0]) for group in groups)
        if fork_server is None and starts_services and ForkServer.is_possible():
            fork_server = stack.enter_context(ForkServer())
        children = stack.enter_context(ChildProcesses(on_exit))
        # First, since nothing is known of its forks while it is stopped.
        server = {FORK_SERVER: fork_server.pid} if fork_server is not None else {}
        stack.enter_context(StopMonitor(lambda: server | children.pids, on_stopped))
        here = [get_process_name(group) for group in groups if not network.is_remote(group[0])]
        router = RunRouter(setup.run_dir, network, socket_dir, crews, mesh=here)
        bus = stack.enter_context(router.open())

        launcher = _Launcher(setup, directory, network, router, children, fork_server)
        restarts = RestartPolicy(setup.scenario, groups, launcher.restart_services)
        supervisor = Supervisor(setup, bus, gateway, events, report, groups, restarts)
        outcome = supervisor.outcome
        expected = [group[0] for group in groups if network.is_remote(group[0])]
        offering = RunServer(setup, expected) if expected else None
        try:
            supervisor.listen()
            if offering is not None:
                offering.serve_on(bus)
            launcher.start_services(groups)
            if fork_server is not None:
                fork_server.release_unused()
            launcher.start_agents(crews, socket_dir)
            gateway.start(children, socket_dir)
            supervisor.await_all_ready(interruption.is_set)
            outcome.start_up_s = time.perf_counter() - began
            supervisor.fly(interruption.is_set)
        except RunEndedError as ended:
            outcome.fault = ended.fault
            if fork_server is not None and ended.fault.participant == FORK_SERVER:
                outcome.fault = replace(ended.fault, text=f"{ended.fault.text}{fork_server.log_tail()}")
        except MachineError as error:
            outcome.fault = supervisor.fault(str(error))
        outcome.is_interrupted = interruption.is_set() and outcome.fault is None
        supervisor.shut_down()
        if fork_server is not None:
            fork_server.wake()
        # Before the start no process has anything to finish, and one that has not joined gets no message.
        children.wait(EXIT_TIMEOUT_S if supervisor.has_begun else 0.0)
        if offering is not None:
            offering.wait_until_gone(EXIT_TIMEOUT_S)
        supervisor.complete()
    return outcome


@dataclass(frozen=True)
class _Launcher:
    """Starts the processes that join the bus, or writes the join files of those that are started elsewhere."""

    setup: RunSetup
    directory: Path
    network: Network
    router: RunRouter
    children: ChildProcesses
    fork_server: ForkServer | None

    def restart_services(self, group: ServiceGroup, how: str) -> None:
        log = self.setup.run_dir.log(get_process_name(group))
        with suppress(OSError):
            append_bytes(log.parent, log.name, f"The process {how}; it is started again.\n".encode())
        self.start_services([group])

    def start_services(self, groups: Sequence[ServiceGroup]) -> None:
        # The last has most to import.
        for group in reversed(groups):
            name, log = get_process_name(group), self.setup.run_dir.log(get_process_name(group))
            is_elsewhere = self.network.is_remote(group[0])
            join = self.router.join_of_service(name, is_watched=not is_elsewhere and can_detect_stops())
            if is_elsewhere:
                self.network.write_join("services", join, self.setup.run_dir.path)
            elif self.fork_server is None:
                command = build_python_command("-m", "gslcosim_services", *group)
                self.children.start(name, command, join=join, log=log)
            else:
                try:
                    self.children.adopt(name, self.fork_server.fork(name, build_fork_request(group, join), log=log))
                except SimulationFault as error:
                    raise RunEndedError(ServiceFault(participant=FORK_SERVER, tick=0, text=str(error))) from error

    def start_agents(self, processes: Iterable[str], private_dir: Path) -> None:
        run_dir, specs = self.setup.run_dir, {agent.name: agent for agent in self.setup.scenario.agents}
        for process in processes:
            command = build_start_command(specs[process], self.directory)
            join = self.router.join_of_process(process, is_watched=command is not None and can_detect_stops())
            if command is None:
                self.network.write_join("agents", join, run_dir.path)
                continue
            confinement = build_confinement(
                specs[process],
                command,
                self.setup,
                directory=self.directory,
                private_dir=private_dir,
                address=f"unix:{self.router.socket}",
            )
            name = get_agent_participant(process)
            self.children.start(
                name, command, join=join, log=run_dir.log(name), cwd=self.directory, confinement=confinement
            )
