"""Sources of a run's gas that events start, stop and move, and whose rates participants set."""

import numpy as np
from built_messages import build_body, build_poses

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning, SourceRate
from gslcosim.contract.participant import Episode
from gslcosim.scenario import load_scenario
from gslcosim_services.fields.core import FieldsCore


def core_of(make_room, *events, more=()):
    changes = [f"events=[{', '.join(events)}]", "gas.turbulence.kind=none", "gas.warm_up_s=2", "gas.step_s=0.1", *more]
    core = FieldsCore(load_scenario("tiny_room", overrides=changes).scenario, make_room())
    core.reset(Episode(seed=1))
    return core


def step(core, tick, *places, filaments_per_s=None):
    inbox = {keys.BODIES: build_poses(tick, build_body("beetle", (3.0, 2.0, 1.0)))}
    if tick:
        inbox[EVENTS] = EventsBeginning(tick=tick - 1, beginning=places)
    if filaments_per_s is not None:
        inbox["truth/sources/0"] = SourceRate(tick=tick - 1, filaments_per_s=filaments_per_s)
    core.step(tick, inbox)
    return len(core.gas.filaments.sigma_m)


def test_a_source_stops_and_starts_again(make_room):
    core = core_of(make_room, "{what: source_stops, at_s: 1}", "{what: source_starts, at_s: 2}")
    first = step(core, 0)
    assert first == 20
    assert [step(core, tick, *([0] if tick == 2 else [])) for tick in (1, 2, 3)] == [21, 21, 21]
    assert [step(core, tick, *([1] if tick == 4 else [])) for tick in (4, 5)] == [22, 23]


def test_a_source_that_an_event_starts_first_is_closed_until_then_and_in_the_warm_up(make_room):
    core = core_of(make_room, "{what: source_starts, at_s: 1}", "{what: source_stops, at_s: 2}")
    assert [step(core, tick, *([0] if tick == 2 else [])) for tick in (0, 1, 2, 3)] == [0, 0, 1, 2]
    core.reset(Episode(seed=1))
    assert step(core, 0) == 0


def test_a_source_that_moves_releases_at_its_new_place_at_its_new_rate(make_room):
    moves = "{what: source_moves, at_s: 1, to_m: [4, 4, 2]}"
    core = core_of(make_room, moves, "{what: source_rate, at_s: 1, filaments_per_s: 30}")
    before = step(core, 0)
    assert step(core, 1, 0, 1) == before + 3
    newest_m = np.asarray(core.gas.filaments.position_world_m)[-3:]
    assert np.linalg.norm(newest_m - (4.0, 4.0, 2.0), axis=1).max() < 0.3


LEAK = "participants=[{name: leak, start: {command: [cat]}, writes: [source_0]}]"


def test_a_source_releases_at_the_rate_that_a_participant_sets_until_the_next(make_room):
    core = core_of(make_room, "{what: source_stops, at_s: 2}", "{what: source_starts, at_s: 3}", more=[LEAK])
    assert not core.prefetch()
    before = step(core, 0)
    rates = [30.0, 15.0, 15.0, 0.0, 0.0, 7.0, None, None, None]
    found = [step(core, tick, filaments_per_s=rate) - before for tick, rate in enumerate(rates, 1)]
    # A tick is 0.1 s: what is less than a filament is kept for the next tick.
    assert found == [3, 4, 6, 6, 6, 6, 7, 8, 8]
    assert step(core, 10, 0, filaments_per_s=100.0) - before == 8, "an event has closed it"
    assert step(core, 11, 1, filaments_per_s=100.0) - before == 18
    core.reset(Episode(seed=1))
    assert [step(core, tick) - before for tick in (0, 1)] == [0, 1]
