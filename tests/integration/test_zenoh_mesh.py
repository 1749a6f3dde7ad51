"""Services of one host as peers: what they send, who is let in, and the mailbox that wakes them."""

import queue
import threading
from pathlib import Path

import pytest
from deadlines import EVENT_S

from gslcosim.base.errors import SimulationFault
from gslcosim.base.files import ScratchFolder
from gslcosim.bus.interface import JoinData, Mesh
from gslcosim.bus.zenoh_bus import SERVICE_ACCOUNT, AgentAccount, ZenohBus, is_mesh_possible

pytestmark = pytest.mark.skipif(not is_mesh_possible(), reason="files without a name are Linux's")

NAMESPACE = "gsl/test"
BUNDLES_FOR_B = "bundle/*/$*.b.$*"


class Net:
    """A router, and the services that have joined it as peers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.members: list[ZenohBus] = []
        self.endpoint = f"unixsock-stream/{folder}/router.sock"
        agents = [AgentAccount(agent="a", password="of a")]
        self.router = ZenohBus.open_router(
            endpoints=[self.endpoint], namespace=NAMESPACE, service_password="s", agents=agents, secrets_dir=folder
        )
        self.members.append(self.router)

    def at(self, name: str) -> str:
        """Return where a service listens."""
        return f"unixsock-stream/{self.folder}/{name}.mesh"

    def join(self, name: str, *calls: str, user: str = SERVICE_ACCOUNT, password: str = "s") -> ZenohBus:
        """Join as a peer that calls others."""
        mesh = Mesh(listen=self.at(name), connect=tuple(self.at(other) for other in calls))
        join = JoinData(name=name, endpoint=self.endpoint, namespace=NAMESPACE, user=user, password=password, mesh=mesh)
        self.members.append(ZenohBus.open_member(join))
        return self.members[-1]


@pytest.fixture
def net():
    with ScratchFolder.for_sockets() as scratch:
        made = Net(scratch.path)
        yield made
        for member in reversed(made.members):
            member.close()


def seen(bus: ZenohBus, key: str) -> threading.Event:
    """Return an event that is set when a token is there."""
    event = threading.Event()
    bus.watch_alive(key, lambda _, is_alive: event.set() if is_alive else None)
    return event


def test_each_message_comes_once_from_peers_and_from_the_router(net):
    a, b = net.join("a"), net.join("b", "a")
    mailbox = b.mailbox(BUNDLES_FOR_B)
    there, at_router = seen(a, "alive/b"), seen(net.router, "alive/b")
    b.declare_alive("alive/b")
    assert there.wait(EVENT_S)
    assert at_router.wait(EVENT_S)
    a.publish("bundle/a/.b.c.", b"peer", urgent=True)
    net.router.publish("bundle/r/.b.", b"router", urgent=True)
    net.router.publish("bundle/r/.c.bb.", b"of others", urgent=True)
    net.router.publish("bundle/r/.b.", b"last", urgent=True)
    came = [mailbox.get(EVENT_S) for _ in range(3)]
    assert sorted(came) == [("bundle/a/.b.c.", b"peer"), ("bundle/r/.b.", b"last"), ("bundle/r/.b.", b"router")]
    assert mailbox.get_nowait() is None


def test_services_that_start_in_any_order_find_each_other(net):
    late = net.join("b", "a")
    there = seen(late, "alive/a")
    early = net.join("a")
    early.declare_alive("alive/a")
    assert there.wait(EVENT_S)


def test_an_agent_is_not_let_in(net):
    """Where services listen, an agent's account is as good as none."""
    service = net.join("a")
    mailbox = service.mailbox("bundle/*/$*.a.$*")
    agent = JoinData(name="a", endpoint=net.at("a"), namespace=NAMESPACE, user="agent_a", password="of a")
    with pytest.raises(SimulationFault, match="could not join it"):
        ZenohBus.open_member(agent)
    assert mailbox.get_nowait() is None
    assert not list(net.folder.glob("*accounts*"))


def test_who_waits_is_woken_by_what_other_threads_put(net):
    mailbox = net.join("b").mailbox(BUNDLES_FOR_B)
    mailbox.put("first", b"1")
    assert mailbox.get(EVENT_S) == ("first", b"1")
    for n in range(50):
        thread = threading.Thread(target=mailbox.put, args=("next", bytes([n])))
        thread.start()
        assert mailbox.get(EVENT_S) == ("next", bytes([n]))
        thread.join()


@pytest.mark.parametrize("timeout_s", [0.01, 0.12])
def test_a_wait_ends(net, timeout_s):
    mailbox = net.join("b").mailbox(BUNDLES_FOR_B)
    with pytest.raises(queue.Empty):
        mailbox.get(timeout_s)
    mailbox.put("later", b"")
    assert mailbox.get(timeout_s) == ("later", b"")
