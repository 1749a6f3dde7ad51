"""The bus over real Zenoh: accounts, what an agent can reach, and how the end of a member is seen."""

import queue
import threading
import time

import pytest
from deadlines import EVENT_S

from gslcosim.base.errors import SimulationFault
from gslcosim.bus.interface import JoinData
from gslcosim.bus.zenoh_bus import AgentAccount, ZenohBus

NAMESPACE = "gsl/test"
PROBE = b"is there a route?"


@pytest.fixture
def net(tmp_path):
    """A router with one service account, agents a and b, and a process of agents c and d; `join` opens members that
    are closed with the test."""
    endpoint = f"unixsock-stream/{tmp_path}/router.sock"
    agents = [AgentAccount(agent=name, password=f"of {name}") for name in ("a", "b")]
    agents.append(AgentAccount(agent="c", password="of c", others=("d",)))
    members = []
    router = ZenohBus.open_router(
        endpoints=[endpoint], namespace=NAMESPACE, service_password="s", agents=agents, secrets_dir=tmp_path
    )

    def join(user, password):
        member = ZenohBus.open_member(
            JoinData(name=user, endpoint=endpoint, namespace=NAMESPACE, user=user, password=password)
        )
        members.append(member)
        return member

    yield router, join
    for member in members:
        member.close()
    router.close()


def inbox(bus, key="**"):
    """Return what a bus hears, and tell `open_route` apart from it."""
    events = queue.Queue()
    events.probed = queue.Queue()
    bus.subscribe(key, lambda at, payload: (events.probed if payload == PROBE else events).put((at, payload)))
    return events


def send(member, key, payload):
    """Send whatever is known of readers, as who cheats would: `publish` sends nothing once it knows of none."""
    member._session.put(key, payload)


def open_route(sender, key, *inboxes):
    """Send on a key until each of these hears it; before there is a route, messages go nowhere."""
    deadline_s = time.monotonic() + EVENT_S
    for events in inboxes:
        while True:
            send(sender, key, PROBE)
            try:
                if events.probed.get(timeout=0.05)[0] == key:
                    break
            except queue.Empty:
                assert time.monotonic() < deadline_s, f"no route for {key} within {EVENT_S} s"


def ask_until_answered(key, n_answers, *askers):
    """Ask until the last of these has so many answers at once: the route is there after a moment.

    Returns:
        The answers of the last one, and the queues of all.
    """
    queues = [queue.Queue() for _ in askers]
    for _ in range(50):
        for asker, answers in zip(askers, queues, strict=True):
            asker.ask(key, b"", lambda _, payload, answers=answers: answers.put(payload))
        try:
            return [queues[-1].get(timeout=0.2) for _ in range(n_answers)], queues
        except queue.Empty:
            continue
    pytest.fail(f"fewer than {n_answers} answers to {key}")


def list_keys(found):
    """Return the keys of what has come so far, without the namespace."""
    samples = [found.get_nowait() for _ in range(found.qsize())]
    return {str(sample.key_expr).removeprefix(f"{NAMESPACE}/") for sample in samples}


def settle(router, *buses):
    """Give what each bus has said time to go through the router: an absence can only be waited for."""
    for bus in buses:
        bus.ask("rpc/settle", b"", lambda *_: None)
        threading.Event().wait(0.1)


def test_the_services_receive_from_each_other(net):
    router, join = net
    ours, theirs = inbox(router, "truth/*"), inbox(join("service", "s"), "truth/*")
    sender = join("service", "s")
    for n in range(200):  # the route is there after a moment; until then messages may go nowhere
        sender.publish("truth/bodies", bytes([n]))
        try:
            assert theirs.get(timeout=0.05)[0] == "truth/bodies"
            break
        except queue.Empty:
            continue
    assert ours.get(timeout=EVENT_S)[0] == "truth/bodies"


def test_an_agent_is_confined_to_its_own_keys(net):
    """It hears only its own keys, its forged messages and tokens reach nobody, others' questions stay unanswered."""
    router, join = net
    service, a, b = join("service", "s"), join("agent_a", "of a"), join("agent_b", "of b")
    at_router, at_service, at_b = inbox(router), inbox(service), inbox(b)
    tokens = queue.Queue()
    router.watch_alive("**", lambda key, is_alive: tokens.put(key))
    a.answer("rpc/world/resend", lambda question: [b"forged"])
    a.declare_alive("alive/world")
    a.declare_alive("agents/b/alive")
    a.declare_alive("agents/a/alive")
    assert tokens.get(timeout=EVENT_S) == "agents/a/alive"
    open_route(a, "agents/a/command", at_router)
    open_route(service, "agents/b/observation", at_router, at_b)
    forbidden = ["truth/bodies", "command/a", "agents/b/command", "agents/b/observation", "agents/a/observation"]
    for key in [*forbidden, "ctl/stop", "bundle/world", "agents/a/command"]:
        send(a, key, b"from a")
    for key in ["truth/bodies", "command/a", "ctl/start", "bundle/world", "agents/a/observation"]:
        send(service, key, b"from service")
    send(service, "agents/b/observation", b"from service")
    assert at_b.get(timeout=EVENT_S) == ("agents/b/observation", b"from service")
    received = [at_router.get(timeout=EVENT_S) for _ in range(7)]
    assert [key for key, payload in received if payload == b"from a"] == ["agents/a/command"]
    answers = queue.Queue()
    router.ask("rpc/world/resend", b"", lambda key, payload: answers.put(payload))
    settle(router, service, b)
    assert at_b.empty()
    assert answers.empty()
    assert tokens.empty()
    assert all(payload == b"from service" or key == "agents/a/command" for key, payload in list(at_service.queue))


def test_a_process_of_several_agents_reaches_the_keys_of_each_and_no_others(net):
    """It speaks and lives for both, hears both, and nothing of a third; a token can be withdrawn alone."""
    router, join = net
    service, process = join("service", "s"), join("agent_c", "of c")
    at_router, at_process = inbox(router, "agents/*/command"), inbox(process)
    tokens = queue.Queue()
    router.watch_alive("agents/*/alive", lambda key, is_alive: tokens.put((key, is_alive)))
    for name in ("a", "c", "d"):
        process.declare_alive(f"agents/{name}/alive")
    assert {tokens.get(timeout=EVENT_S) for _ in range(2)} == {("agents/c/alive", True), ("agents/d/alive", True)}
    process.withdraw_alive("agents/d/alive")
    assert tokens.get(timeout=EVENT_S) == ("agents/d/alive", False)
    for name in ("c", "d"):
        open_route(process, f"agents/{name}/command", at_router)
        open_route(service, f"agents/{name}/observation", at_process)
    for name in ("a", "c", "d"):
        send(process, f"agents/{name}/command", b"from c")
        send(service, f"agents/{name}/observation", b"from service")
    assert [at_router.get(timeout=EVENT_S)[0] for _ in range(2)] == ["agents/c/command", "agents/d/command"]
    received = [at_process.get(timeout=EVENT_S) for _ in range(5)]
    keys_of_service = [key for key, payload in received if payload == b"from service"]
    assert keys_of_service == ["agents/c/observation", "agents/d/observation"]
    settle(router, service)
    assert at_router.empty()
    assert tokens.empty()


def test_a_wrong_password_is_refused_with_a_reason(net):
    _, join = net
    with pytest.raises(SimulationFault, match="user 'agent_a' and its password were refused"):
        join("agent_a", "guessed")


def test_the_passwords_are_not_left_on_disk(net, tmp_path):
    assert list(tmp_path.glob("accounts*")) == []


def test_the_end_of_a_member_is_seen(net):
    router, join = net
    states = queue.Queue()
    router.watch_alive("alive/*", lambda key, is_alive: states.put((key, is_alive)))
    member, other = join("service", "s"), join("service", "s")
    lost = threading.Event()
    other.on_disconnect(lost.set)
    member.declare_alive("alive/fields")
    assert states.get(timeout=EVENT_S) == ("alive/fields", True)
    member.close()
    assert states.get(timeout=EVENT_S) == ("alive/fields", False)
    router.close()
    assert lost.wait(EVENT_S)


def test_all_answers_to_one_question_come(net):
    """What follows a lost message is sent with it; each of them is another answer under the same key."""
    _, join = net
    writer, reader = join("service", "s"), join("service", "s")
    writer.answer("rpc/world/resend", lambda question: [bytes([n]) for n in range(5)])
    came, _ = ask_until_answered("rpc/world/resend", 5, reader)
    assert sorted(came) == [bytes([n]) for n in range(5)]


def test_who_asks_after_the_session_was_closed_receives_nothing(net):
    _, join = net
    asker = join("service", "s")
    asker.close()
    answers = []
    asker.ask("rpc/world/inspect", b"", lambda *answer: answers.append(answer))
    assert answers == []


def test_what_the_routers_own_session_answers_is_for_services_alone(net):
    """Other hosts ask it for scenario and room: an agent that asks hears nothing."""
    router, join = net
    service, agent = join("service", "s"), join("agent_a", "of a")
    router.answer("rpc/run/offer", lambda question: [b"the scenario"])
    came, (of_agent, _) = ask_until_answered("rpc/run/offer", 1, agent, service)
    assert came == [b"the scenario"]
    settle(router, agent)
    agent.ask("rpc/run/offer", b"", lambda _, payload: of_agent.put(payload))
    settle(router, agent)
    assert of_agent.empty()


def test_an_agent_reaches_no_ros_graph_over_the_runs_router(net):
    """No `*` covers a part of a key that begins with @: what is not allowed is denied, to agents and to services."""
    router, join = net
    service, cheat, spy = join("service", "s"), join("agent_a", "of a"), join("agent_b", "of b")
    commands, observations = inbox(service, "agents/a/command"), inbox(spy, "agents/b/observation")
    open_route(cheat, "agents/a/command", commands)
    open_route(service, "agents/b/observation", observations)
    token, goal, gas = "@ros2_lv/0/a1/0/0/NN/%/%/spy", "0/beetle/goal/T/RIHS01_0", "0/beetle/nose/T/RIHS01_0"
    forged, leaked = queue.SimpleQueue(), queue.SimpleQueue()
    held = []
    for bus, keys, found in ((service, (token, goal), forged), (spy, ("@ros2_lv/**", "0/**", "**"), leaked)):
        for key in keys:
            held.append(bus._session.declare_subscriber(key, found.put))
            held.append(bus._session.liveliness().declare_subscriber(key, found.put, history=True))
    for key in (token, goal):
        held.append(cheat._session.liveliness().declare_token(key))
        send(cheat, key, b"forged")
    held += [service._session.liveliness().declare_token(key) for key in (token, gas)]
    send(router, gas, b"secret")
    send(cheat, "agents/a/command", b"last")
    send(router, "agents/b/observation", b"last")
    assert commands.get(timeout=EVENT_S) == ("agents/a/command", b"last")
    assert observations.get(timeout=EVENT_S) == ("agents/b/observation", b"last")
    settle(router, service, spy)
    assert list_keys(forged) <= {token}
    assert list_keys(leaked) <= {"agents/b/observation"}
