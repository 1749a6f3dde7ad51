"""Laws of the radio: nobody hears what is out of range, losses come at their rate, and each pair has its own."""

import math

import pytest
from built_messages import build_body
from built_scenarios import build_agent, build_scenario
from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, Command, RadioMessage
from gslcosim.contract.participant import Episode
from gslcosim_services.radio.core import RadioCore

COORDINATES_M = st.floats(-50, 50)
PLACES_M = st.tuples(COORDINATES_M, COORDINATES_M, COORDINATES_M)
RANGES_M = st.floats(0.01, 100)


def swarm(n_agents, seed=1, **channel):
    agents = (build_agent(f"a{i}", (i, 1, 0)) for i in range(n_agents))
    return RadioCore(build_scenario(*agents, seed=seed, channels=[{"name": "radio", **channel}]))


def fly(core, places_m, senders, n_ticks=1, seed=1):
    """Let the senders say one thing each at every tick; return what became of it: [(sender, transmission)]."""
    core.reset(Episode(seed=seed))
    bodies = tuple(build_body(f"a{i}", place_m) for i, place_m in enumerate(places_m))
    found = []
    for tick in range(1, n_ticks + 1):
        inbox = {keys.BODIES: BodyPoses(tick=tick - 1, bodies=bodies)}
        for sender in senders:
            message = RadioMessage(channel="radio", text=str(tick))
            inbox[keys.command(sender)] = Command(tick=tick - 1, kind="noop", outgoing=(message,))
        found += core.step(tick, inbox)[keys.RADIO].transmissions
    return found


@settings(max_examples=60)
@given(places_m=st.lists(PLACES_M, min_size=2, max_size=6), range_m=RANGES_M)
def test_exactly_those_within_range_are_reached(places_m, range_m):
    core = swarm(len(places_m), range_m=range_m)
    for sent in fly(core, places_m, [f"a{i}" for i in range(len(places_m))]):
        here_m = places_m[int(sent.sender[1:])]
        near = {f"a{i}" for i, place_m in enumerate(places_m) if math.dist(here_m, place_m) <= range_m}
        assert set(sent.reached) == near - {sent.sender}
        assert len(sent.reached) + len(sent.out_of_range) == len(places_m) - 1


@settings(max_examples=40)
@given(places_m=st.lists(PLACES_M, min_size=2, max_size=4), near_m=RANGES_M, far_m=RANGES_M)
def test_more_range_never_reaches_fewer(places_m, near_m, far_m):
    near_m, far_m = sorted((near_m, far_m))
    senders = [f"a{i}" for i in range(len(places_m))]
    less, more = (
        fly(swarm(len(places_m), range_m=range_m, loss_frac=0.5), places_m, senders, n_ticks=3)
        for range_m in (near_m, far_m)
    )
    assert all(set(a.reached) <= set(b.reached) for a, b in zip(less, more, strict=True))


@settings(max_examples=15)
@given(loss_frac=st.floats(0, 1), seed=st.integers(0, 2**31))
def test_losses_come_at_their_rate(loss_frac, seed):
    """Within 5 standard deviations of the binomial distribution, and 2 for rates at which it is not round."""
    n = 400
    sent = fly(swarm(2, loss_frac=loss_frac), [(0.0, 0.0, 0.0)] * 2, ["a0"], n_ticks=n, seed=seed)
    n_lost = sum(len(item.lost) for item in sent)
    assert n_lost == pytest.approx(n * loss_frac, abs=5 * math.sqrt(n * loss_frac * (1 - loss_frac)) + 2)
    assert n_lost + sum(len(item.reached) for item in sent) == n


@settings(max_examples=15)
@given(loss_frac=st.floats(0, 1), n_more=st.integers(0, 3))
def test_what_a_pair_loses_does_not_depend_on_others(loss_frac, n_more):
    alone = fly(swarm(2, loss_frac=loss_frac), [(0.0, 0.0, 0.0)] * 2, ["a0"], n_ticks=20)
    n = 2 + n_more
    crowd = fly(swarm(n, loss_frac=loss_frac), [(0.0, 0.0, 0.0)] * n, [f"a{i}" for i in range(n)], n_ticks=20)
    is_received = ["a1" in sent.reached for sent in crowd if sent.sender == "a0"]
    assert is_received == [sent.reached == ("a1",) for sent in alone]
