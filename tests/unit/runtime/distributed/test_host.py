"""Hosts over a bus: the same digest as in one thread, also when messages get lost; failures reach the supervisor."""

import math
import queue
import threading

import numpy as np
import pytest
from deadlines import EVENT_S
from in_memory_bus import InMemoryHub
from toy_cores import ToyAgent, ToyFields, toy_cores, toy_dataflow

from gslcosim.contract import keys
from gslcosim.contract.messages import FieldSamples, MountSample
from gslcosim.contract.participant import Episode
from gslcosim.contract.record import build_unchecked_constructor
from gslcosim.runtime.digest import HashChain, RunDigest
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.host import MIN_RESEND_AFTER_S, Host

FINAL_TICK = 100


def fly(hub, cores, groups=None):
    """Run a host for each group of cores in a thread; return the digest, the timings and the reported faults."""
    groups = groups or [[name] for name in cores]
    events = queue.Queue()
    ours = hub.open()
    for key in ("ctl/bye/*", protocol.FAULT_KEY):
        ours.subscribe(key, lambda at, payload: events.put((at, payload)))
    hosts = [Host(hub.open(), [cores[name] for name in group], toy_dataflow(), Episode(seed=7)) for group in groups]
    for host in hosts:
        host.join()
    threads = [threading.Thread(target=_run_quietly, args=(host,), daemon=True) for host in hosts]
    for thread in threads:
        thread.start()
    ours.publish(protocol.START_KEY, b"")
    reports, faults = {}, []
    while len(reports) < len(cores) and not faults:
        key, payload = events.get(timeout=EVENT_S)
        if key == protocol.FAULT_KEY:
            faults.append(protocol.FaultReport.from_bytes(payload))
        else:
            report = protocol.FinalReport.from_bytes(payload)
            reports[report.name] = report
            if report.name == "referee":
                ours.publish(protocol.STOP_KEY, protocol.TickReport(tick=report.last_tick).to_bytes())
    ours.publish(protocol.CLOSE_KEY, b"")
    for thread in threads:
        thread.join(timeout=EVENT_S)
        assert not thread.is_alive()
    trails = {
        port: HashChain.from_fields(fields) for report in reports.values() for port, fields in report.trails.items()
    }
    digest = RunDigest(FINAL_TICK, {}, {port: trail.until(FINAL_TICK) for port, trail in trails.items()})
    return digest, reports, faults


def _run_quietly(host):
    try:
        host.run()
    except Exception:
        return


@pytest.mark.slow
def test_lost_messages_are_asked_for_again_and_change_nothing():
    clean, reports, _ = fly(InMemoryHub(), toy_cores())
    assert sum(report.timing["n_resends"] for report in reports.values()) == 0
    hub = InMemoryHub(loss_frac=0.15, seed=3)
    cores = toy_cores()
    lossy, reports, _ = fly(hub, cores)
    assert hub.n_lost > 0
    assert sum(report.timing["n_resends"] for report in reports.values()) > 0
    assert lossy.hex == clean.hex


@pytest.mark.slow
def test_lost_messages_are_asked_for_again_though_other_messages_keep_coming():
    """A signal that is sent all the time wakes every waiting host before its patience has ended."""
    hub, is_over = InMemoryHub(loss_frac=0.15, seed=3), threading.Event()

    pause_s = MIN_RESEND_AFTER_S / 20

    def repeat_start():
        ours = hub.open()
        while not is_over.wait(pause_s):
            ours.publish(protocol.START_KEY, b"")

    talking = threading.Thread(target=repeat_start, daemon=True)
    talking.start()
    try:
        lossy, _, _ = fly(hub, toy_cores())
    finally:
        is_over.set()
        talking.join()
    clean, _, _ = fly(InMemoryHub(), toy_cores())
    assert lossy.hex == clean.hex


class BusyFields(ToyFields):
    """Has a little to do beside its steps."""

    n_left = 5

    def prefetch(self):
        self.n_left -= 1
        return self.n_left >= 0


def test_a_core_works_ahead_where_it_would_wait_and_then_waits():
    clean, _, _ = fly(InMemoryHub(), toy_cores())
    cores = toy_cores()
    cores["fields"] = BusyFields(cores["fields"].spec)
    busy, _, faults = fly(InMemoryHub(), cores)
    assert not faults
    assert cores["fields"].n_left < 0
    assert busy.hex == clean.hex


@pytest.mark.parametrize("seed", range(12))
def test_whatever_shares_a_process_the_digest_is_the_same(seed):
    alone, _, _ = fly(InMemoryHub(), toy_cores())
    rng = np.random.default_rng(seed)
    names = list(toy_cores())
    n_groups = int(rng.integers(1, len(names) + 1))
    group_of = rng.integers(0, n_groups, len(names))
    groups = [[n for n, g in zip(names, group_of, strict=True) if g == i] for i in range(n_groups)]
    hub = InMemoryHub(loss_frac=0.05 * (seed % 2), seed=seed)
    grouped, reports, faults = fly(hub, toy_cores(), [group for group in groups if group])
    assert not faults
    assert set(reports) == set(names)
    assert grouped.hex == alone.hex


@pytest.mark.parametrize("is_one_group", [False, True])
def test_a_core_that_fails_is_named(is_one_group):
    class Broken(ToyFields):
        def step(self, tick, inbox):
            if tick == 5:
                raise ArithmeticError("the field has burst")
            return super().step(tick, inbox)

    cores = toy_cores()
    cores["fields"] = Broken(cores["fields"].spec)
    _, _, (fault,) = fly(InMemoryHub(), cores, [list(cores)] if is_one_group else None)
    assert (fault.participant, fault.tick) == ("fields", 4)
    assert "the field has burst" in fault.text


def test_a_core_that_breaks_its_declaration_is_named():
    class Chatty(ToyAgent):
        def step(self, tick, inbox):
            return {**super().step(tick, inbox), keys.BODIES: None}

    cores = toy_cores()
    cores["agent_beetle"] = Chatty(cores["agent_beetle"].spec)
    _, _, (fault,) = fly(InMemoryHub(), cores)
    assert fault.participant == "agent_beetle"
    assert "expected messages on []" in fault.text


@pytest.mark.parametrize("poison", [math.nan, math.inf, -math.inf])
def test_a_core_that_writes_what_is_not_finite_is_named_though_it_makes_messages_without_checks(poison):
    class Poisonous(ToyFields):
        def step(self, tick, inbox):
            if tick != 5:
                return super().step(tick, inbox)
            sample = build_unchecked_constructor(MountSample)(
                agent="beetle", sensor="nose", gases=(), wind_world_m_s=(0.0, poison, 0.0)
            )
            return {
                **super().step(tick, inbox),
                keys.SAMPLES: build_unchecked_constructor(FieldSamples)(tick=tick, samples=(sample,)),
            }

    cores = toy_cores()
    cores["fields"] = Poisonous(cores["fields"].spec)
    _, _, (fault,) = fly(InMemoryHub(), cores)
    assert fault.participant == "fields"
    assert "FieldSamples: samples.0.wind_world_m_s.1: input should be a finite number" in fault.text
