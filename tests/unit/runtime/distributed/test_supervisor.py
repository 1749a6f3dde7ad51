"""The supervisor of a run over processes: whose fault ends it, whatever order events come in."""

import queue
import threading

import pytest
from built_runs import build_setup
from deadlines import EVENT_S
from in_memory_bus import InMemoryBus, InMemoryHub

from gslcosim.base.processes import Interruption
from gslcosim.runtime.agents.gateway_transport import GatewayAgents
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.protocol import MessageReceived, ProcessEnded
from gslcosim.runtime.distributed.supervisor import RunEndedError, Supervisor
from gslcosim.runtime.distributed.watchdog import RestartPolicy
from gslcosim.runtime.network import Network
from gslcosim.runtime.services import group_services, list_service_names
from gslcosim.scenario import load_scenario


@pytest.fixture(scope="module")
def loaded():
    return load_scenario("tiny_room")


@pytest.fixture
def events():
    return queue.SimpleQueue()


@pytest.fixture
def hub():
    return InMemoryHub()


@pytest.fixture
def supervisor(loaded, events, tmp_path, hub):
    setup = build_setup(loaded, tmp_path)
    groups = group_services("separate", list_service_names(loaded.scenario))
    gateway = GatewayAgents(setup, loaded.directory, Network(), events.put)
    restarts = RestartPolicy(loaded.scenario, groups, lambda group, how: None)
    return Supervisor(setup, InMemoryBus(hub), gateway, events, lambda status: None, groups, restarts)


def fault_of(supervisor):
    with pytest.raises(RunEndedError) as ended, Interruption() as interruption:
        supervisor.await_all_ready(interruption.is_set)
    return ended.value.fault


def test_a_service_that_ends_by_itself_may_say_why_after_its_end_was_seen(supervisor, events):
    """The operating system tells the end at once; the report comes over the bus, and may take longer on a busy machine.

    It was lost in one of 770 tests: "ended with exit code 3", where the disk was full.
    """
    report = protocol.FaultReport(participant="recorder", tick=4, text="no space left on device")
    late = threading.Timer(0.05, events.put, [MessageReceived(protocol.FAULT_KEY, report.to_bytes())])
    events.put(ProcessEnded("recorder", "ended with exit code 3", is_by_itself=True))
    late.start()
    fault = fault_of(supervisor)
    late.join(EVENT_S)
    assert (fault.participant, fault.tick, fault.text) == ("recorder", 4, "no space left on device")


@pytest.mark.parametrize(("how", "is_by_itself"), [("ended with exit code 3", True), ("was killed by SIGKILL", False)])
def test_a_service_that_says_nothing_is_named_by_how_it_ended(supervisor, events, how, is_by_itself):
    events.put(ProcessEnded("fields", how, is_by_itself=is_by_itself))
    fault = fault_of(supervisor)
    assert fault.participant == "fields"
    assert fault.text.startswith(how)


def test_a_service_whose_answer_is_lost_is_asked_again(supervisor, hub):
    other = protocol.ParticipantDescription(name="world", version="0.0.0", contract_hash="0" * 32, pid=1, host="other")
    answers = [[], [other.to_bytes()]]
    InMemoryBus(hub).answer(protocol.build_description_key("world"), lambda _: answers.pop(0))
    fault = fault_of(supervisor)
    assert fault.participant == "world"
    assert fault.text.startswith("expected contract")
    assert not answers
