"""Whatever ends a run has a name: its last messages may come in any order, twice, late or never."""

import queue
from functools import partial
from types import SimpleNamespace

import pytest
from built_runs import build_setup
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from in_memory_bus import InMemoryBus, InMemoryHub

from gslcosim.base.errors import ExitCode
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Observation, Verdict
from gslcosim.runtime import loop_host
from gslcosim.runtime.agents.gateway_transport import GatewayAgents
from gslcosim.runtime.agents.session import AgentJoined
from gslcosim.runtime.digest import HashChain
from gslcosim.runtime.distributed import protocol, supervisor, watchdog
from gslcosim.runtime.distributed.host import FINAL_REPORT_PERIOD_S
from gslcosim.runtime.distributed.protocol import Interrupted, MessageReceived, ProcessEnded
from gslcosim.runtime.distributed.retransmission import RetransmitBuffer
from gslcosim.runtime.distributed.supervisor import RunEndedError, Supervisor
from gslcosim.runtime.distributed.watchdog import RestartPolicy
from gslcosim.runtime.network import Network
from gslcosim.runtime.outcome import RunOutcome
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import build_dataflow, group_services, list_service_names
from gslcosim.runtime.stepper import SentMessage
from gslcosim.scenario import load_scenario

LAST_TICK = 3
# Services have stepped further before they were stopped.
LEAD_TICKS = 2
# Longer than the repetitions of all that may get lost, but not for ever.
LIMIT_S = 12.0
FOR_EVER = 10**9
LOSSES = st.sampled_from([0, 0, 0, 1, 2, 7, FOR_EVER])
MANY = settings(max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture])


class Clock:
    """Time that passes only where the supervisor waits for an event."""

    def __init__(self):
        self.now_s = 1000.0

    def monotonic(self):
        return self.now_s

    perf_counter = monotonic


class Members:
    """The services of a run that is over: what they have written last, on its way to the supervisor, and their answers.

    Args:
        clock: Its time.
        arrivals: The first messages, in the order in which they come.
        lost: How many of the copies of each message get lost, by its name; those of answers too.
        silent: Services whose process has ended, which repeat nothing and answer nothing.
    """

    def __init__(self, clock, messages, arrivals, lost, silent=()):
        self.clock, self.messages, self.lost, self.silent = clock, messages, dict(lost), silent
        self.came, self.repeated_at_s, self.is_interrupted = queue.SimpleQueue(), clock.now_s, False
        for name in arrivals:
            self.send(name)

    def send(self, name):
        if self.lost.get(name, 0) > 0:
            self.lost[name] -= 1
        else:
            self.came.put(self.messages[name])

    def put(self, event):
        self.came.put(event)

    def get(self, timeout=None):
        if self.came.empty():
            self.clock.now_s += timeout
            if self.clock.now_s - self.repeated_at_s >= FINAL_REPORT_PERIOD_S:
                self.repeated_at_s = self.clock.now_s
                for name in self.messages:
                    if name.startswith("report ") and name.removeprefix("report ") not in self.silent:
                        self.send(name)
            if self.came.empty():
                raise queue.Empty
        event = self.came.get()
        self.is_interrupted = self.is_interrupted or isinstance(event, Interrupted)
        return event

    def empty(self):
        """Let nobody take two at once: what comes next may take a while."""
        return True

    def answer(self, service, kept, question):
        """Answer a question as a service does, unless question or answer gets lost."""
        name = f"answer {protocol.ResendRequest.from_bytes(question).port}"
        if service in self.silent or self.lost.get(name, 0) > 0:
            self.lost[name] = self.lost.get(name, 0) - 1
            return []
        return kept.answer(question)


class Ends:
    """Last messages of a run of a scenario, and what a supervisor makes of them."""

    def __init__(self, name, folder):
        loaded = load_scenario(name)
        self.scenario, self.directory, self.folder = loaded.scenario, loaded.directory, folder
        self.setup = build_setup(loaded, folder, run_dir=RunDir(folder))
        self.services = list_service_names(loaded.scenario)
        self.agents = [agent.name for agent in loaded.scenario.agents]
        self.sent = {}
        self.messages = {}
        for agent in self.agents:
            for tick in range(LAST_TICK + 1 + LEAD_TICKS):
                message = Observation(
                    tick=tick, agent=agent, time_s=0.0, position_world_m=(0, 0, 0), yaw_rad=0.0,
                    velocity_world_m_s=(0, 0, 0), status="flying", awaiting_command=False, readings=(),
                )  # fmt: skip
                self._add(f"observation {agent} {tick}", keys.observation(agent), message)
        self._add("verdict", keys.VERDICT, Verdict(tick=LAST_TICK, end_reason="success", agents=()))
        writer_of = build_dataflow(loaded.scenario).writer_of
        for service in self.services:
            n_steps = LAST_TICK + 1 + (0 if service == "referee" else LEAD_TICKS)
            self.messages[f"report {service}"] = build_report(service, writer_of, n_steps)

    def _add(self, name, port, message):
        self.sent[name] = SentMessage(port, message, codec.encode(message))
        self.messages[name] = MessageReceived("bundle/x/.y.", protocol.pack_bundle([(port, self.sent[name].payload)]))

    def end(self, arrivals, lost=(), *, extra=None, silent=()):
        """Return the outcome of a run whose last messages come like that."""
        clock, hub = Clock(), InMemoryHub()
        members = Members(clock, self.messages | (extra or {}), arrivals, dict(lost), silent)
        for service in ("sensing", "referee"):
            kept = RetransmitBuffer()
            for sent in self.sent.values():
                if (sent.port == keys.VERDICT) == (service == "referee"):
                    kept.keep(sent)
            hub.open().answer(protocol.build_resend_key(service), partial(members.answer, service, kept))
        for service in self.services:
            hub.open().answer(protocol.build_inspection_key(service), lambda _, name=service: [build_inspection(name)])
        self.signals = []
        for key in (protocol.START_KEY, protocol.STOP_KEY):
            hub.open().subscribe(key, lambda key, _: self.signals.append(key))
        groups = group_services("separate", self.services)
        gateway = GatewayAgents(self.setup, self.directory, Network(), members.put)
        restarts = RestartPolicy(self.scenario, groups, lambda group, how: None)
        with pytest.MonkeyPatch.context() as patch:
            clocks = SimpleNamespace(monotonic=clock.monotonic, perf_counter=clock.perf_counter)
            for module in (loop_host, supervisor):
                patch.setattr(module, "time", clocks)
            patch.setattr(watchdog, "STALL_TIMEOUT_S", LIMIT_S)
            patch.setattr(watchdog, "FINISH_TIMEOUT_S", LIMIT_S)
            watched = Supervisor(self.setup, InMemoryBus(hub), gateway, members, lambda status: None, groups, restarts)
            outcome = watched.outcome
            for agent in self.agents:
                members.put(AgentJoined(agent=agent))
            try:
                watched.fly(lambda: members.is_interrupted)
            except RunEndedError as ended:
                outcome.fault = ended.fault
            outcome.is_interrupted = members.is_interrupted and outcome.fault is None
            watched.shut_down()
            watched.complete()
        self.took_s = clock.now_s - 1000.0
        return outcome


def build_report(service, writer_of, n_steps, **changes):
    chains = {}
    for port in (port for port, writer in writer_of.items() if writer == service):
        chain = HashChain()
        for tick in range(n_steps):
            chain.append(tick, port.encode())
        chains[port] = chain.as_fields()
    fields = {"name": service, "last_tick": n_steps - 1, "trails": chains, "timing": {}} | changes
    key = protocol.build_final_report_key(service)
    return MessageReceived(key, protocol.FinalReport(**fields).to_bytes())


def build_inspection(service):
    return protocol.ParticipantInspection(
        name=service, state="done", tick=LAST_TICK, missing=(), lacking_credit=(), occupied_s=None, queued_ticks=0,
        pid=1, cpu_s=0.0, memory_bytes=None, n_resends=0,
    ).to_bytes()  # fmt: skip


@pytest.fixture(scope="module", params=["tiny_room", "swarm_tiny"])
def ends(request, tmp_path_factory):
    return Ends(request.param, tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def digest(ends):
    return ends.end(ends.messages).digest.hex


def has_name(outcome):
    return outcome.is_valid or outcome.is_interrupted or outcome.fault is not None


def test_messages_in_order_end_a_run(ends, digest):
    """Otherwise nothing here would prove anything."""
    outcome = ends.end(ends.messages)
    assert (outcome.is_valid, outcome.digest.hex, outcome.ticks_flown) == (True, digest, LAST_TICK)
    assert ends.took_s == 0.0


def test_a_verdict_that_every_report_overtakes_is_waited_for(ends, digest):
    """Each subscription has a thread of its own: on a busy machine one run of four ended without a verdict."""
    late = ["verdict", *(name for name in ends.messages if name.startswith("observation"))]
    reports = [name for name in ends.messages if name.startswith("report")]
    assert ends.end([*reports, *late]).digest.hex == digest
    assert ends.end(reports).digest.hex == digest


def test_start_and_stop_are_sent_again_to_a_service_that_lost_them(ends, digest):
    """On a busy machine one run in hundreds waited for a service that waited for the start."""
    assert ends.end(ends.messages, {"report world": 9}).digest.hex == digest
    assert ends.took_s > 4
    assert ends.signals.count(protocol.START_KEY) > 2
    assert ends.signals.count(protocol.STOP_KEY) > 2


@pytest.mark.slow
@MANY
@given(data=st.data())
def test_any_order_losses_and_repetitions_end_with_the_digest_or_a_name(ends, digest, data):
    """What is lost for ever is named with the one that wrote it; everything else leads to one digest."""
    names = list(ends.messages)
    repeated = data.draw(st.lists(st.sampled_from(names), max_size=6), label="repeated")
    arrivals = data.draw(st.permutations(names + repeated), label="arrivals")
    prone = [*names, *(f"answer {port}" for port in (keys.VERDICT, *map(keys.observation, ends.agents)))]
    lost = data.draw(st.dictionaries(st.sampled_from(prone), LOSSES, max_size=8), label="lost")
    outcome = ends.end(arrivals, lost)
    missing = {writer for name in names if (writer := find_writer_of_lost(name, arrivals, lost))}
    if missing:
        assert outcome.fault.participant in missing, outcome.fault.text
        assert outcome.digest is None
        assert outcome.exit_code is ExitCode.TIMEOUT
        assert ends.took_s < 3 * LIMIT_S
    else:
        assert outcome.fault is None
        assert outcome.digest.hex == digest


# Reports are repeated; the verdict and observations up to its tick are asked for, and an answer brings all that follow.
def find_writer_of_lost(name, arrivals, lost):
    kind, *rest = name.split()
    if kind == "report":
        return rest[0] if lost.get(name) == FOR_EVER else None
    port, tick = (keys.VERDICT, LAST_TICK) if kind == "verdict" else (keys.observation(rest[0]), int(rest[1]))
    is_lost = lost.get(name, 0) >= arrivals.count(name) and lost.get(f"answer {port}") == FOR_EVER
    if not is_lost or tick > LAST_TICK:
        return None
    return "referee" if kind == "verdict" else "sensing"


@settings(MANY, max_examples=60)
@given(data=st.data())
@example(data=None)
def test_an_end_of_a_process_or_an_interruption_among_them_has_a_name(ends, digest, data):
    """A process that ends with exit code 0 before its report was heard, one that fails, and Ctrl-C."""
    names = list(ends.messages)
    if data is None:
        service, how, arrivals = "recorder", "ended with exit code 0", ["end"]
    else:
        service = data.draw(st.sampled_from(ends.services))
        how = data.draw(st.sampled_from(["ended with exit code 0", "ended with exit code 3", "interruption"]))
        kept = data.draw(st.permutations(names))[: data.draw(st.integers(0, len(names)))]
        at = data.draw(st.integers(0, len(kept)))
        arrivals = [*kept[:at], "interruption" if how == "interruption" else "end", *kept[at:]]
    event = Interrupted() if how == "interruption" else ProcessEnded(service, how, is_by_itself=how.endswith("3"))
    outcome = ends.end(arrivals, extra={"interruption": event, "end": event}, silent=(service,))
    assert has_name(outcome)
    if outcome.is_valid:
        assert outcome.digest.hex == digest
    if outcome.fault is not None:
        assert outcome.fault.participant in (service, *(name for name in ends.services if f"report {name}" in names))
    if how == "interruption":
        assert outcome.is_interrupted or outcome.is_valid


@pytest.mark.parametrize(
    "changes",
    [{"last_tick": LAST_TICK - 1}, {"trails": {}}, {"trails": {"truth/none": {"ticks": [], "links": ""}}}],
    ids=["a tick short", "without chains", "another port"],
)
def test_a_report_that_is_not_whole_is_named_and_gives_no_digest(ends, changes):
    """Its process was dismissed early, or it comes from a host that lies."""
    writer_of = build_dataflow(ends.scenario).writer_of
    short = {"report world": build_report("world", writer_of, LAST_TICK + 1, **changes)}
    outcome = ends.end(ends.messages, extra=short)
    assert (outcome.fault.participant, outcome.digest) == ("world", None)
    assert "final report" in outcome.fault.text


def test_a_report_of_a_stranger_ends_nothing(ends, digest):
    """A name that is none of the run's does not stand for a service whose report lacks."""
    stranger = MessageReceived(protocol.build_final_report_key("world"), protocol.FinalReport(
        name="stranger", last_tick=9, trails={}, timing={}).to_bytes())  # fmt: skip
    arrivals = ["stranger", *(name for name in ends.messages if name != "report world")]
    assert ends.end(arrivals, extra={"stranger": stranger}).digest.hex == digest


def test_an_outcome_without_any_name_is_refused():
    """Verdict and digest, an interruption, a cut or a fault: one of them has to be there."""
    for fields in ({}, {"verdict": Verdict(tick=3, end_reason="success", agents=())}):
        outcome = RunOutcome(**fields)
        outcome.require_reason()
        assert outcome.fault.participant == "supervisor"
        assert outcome.exit_code is ExitCode.FAULT
    for fields in ({"is_interrupted": True}, {"is_cut": True}):
        outcome = RunOutcome(**fields)
        outcome.require_reason()
        assert outcome.fault is None
