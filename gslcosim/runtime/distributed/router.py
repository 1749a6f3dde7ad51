"""Router of a run, and the accounts with which services and agents join it."""

from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path

from gslcosim.bus.interface import JoinData, Mesh
from gslcosim.bus.zenoh_bus import SERVICE_ACCOUNT, AgentAccount, ZenohBus, generate_password, is_mesh_possible
from gslcosim.runtime.network import Network
from gslcosim.runtime.run_dir import RunDir


class RunRouter:
    """Opens the router on a private unix socket, and on what the network adds; passwords are in no file.

    Args:
        run_dir: The run; its id is the namespace.
        network: Where else the router listens.
        socket_dir: A private folder for the socket.
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
