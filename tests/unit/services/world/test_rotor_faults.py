"""A rotor that gives less than the control believes."""

from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.participant import Episode
from gslcosim_services.world.core import WorldCore

LOST_AT = 60


def heights_m(core, n_ticks=120):
    """Return the heights of a vehicle that rises and hovers, and whose event begins at a tick."""
    core.reset(Episode(seed=0))
    heights = []
    for tick in range(n_ticks):
        beginning = (0,) if tick == LOST_AT else ()
        inbox = {EVENTS: EventsBeginning(tick=tick - 1, beginning=beginning)} if tick else {}
        heights.append(core.step(tick, inbox)["truth/bodies"].bodies[0].position_world_m[2])
    return heights


def core_of(make_room, make_scenario, share):
    event = {"what": "rotor_weakens", "at_s": 6.0, "agent": "agent_0", "rotor": 0, "share": share}
    return WorldCore(make_scenario({"start_m": (7.0, 5.0, 0.1)}, events=[event]), make_room())


def test_a_weak_rotor_is_felt_from_its_event_on_and_a_lost_one_brings_the_vehicle_down(make_room, make_scenario):
    sound, weak, lost = (heights_m(core_of(make_room, make_scenario, share)) for share in (1.0, 0.8, 0.0))
    assert sound[:LOST_AT] == weak[:LOST_AT] == lost[:LOST_AT]
    assert 0.001 < max(abs(a - b) for a, b in zip(sound, weak, strict=True)) < 0.5
    assert lost[-1] < sound[-1] - 1.0


def test_a_new_run_begins_with_sound_rotors(make_room, make_scenario):
    core = core_of(make_room, make_scenario, 0.0)
    assert heights_m(core) == heights_m(core)
