"""The world that a check plays is the same for every agent, and has all that a session has."""

import msgpack

from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Command, Observation
from gslcosim_conformance.scripted_world import (
    REFUSED_QUESTION,
    ROOM_M,
    ScriptedWorld,
    add_unknown_fields,
    build_briefing,
    iter_ticks,
)


def fly(seed):
    world = ScriptedWorld(seed)
    seen = []
    for n, (tick, is_asked) in enumerate(iter_ticks()):
        seen.append(world.observe(tick, is_asked=is_asked))
        if is_asked:
            world.obey(Command(tick=tick, kind="waypoint", position_world_m=(5.0 + 0.1 * (n % 7), 4.0, 1.5)))
    return seen


def test_the_same_seed_and_commands_give_the_same_observations():
    assert fly(1) == fly(1)
    assert fly(1) != fly(2)


def test_ticks_grow_and_questions_lie_on_both_sides_of_where_integers_get_longer():
    played = list(iter_ticks())
    assert [tick for tick, _ in played] == sorted({tick for tick, _ in played})
    asked = {tick for tick, is_asked in played if is_asked}
    assert {2**7 - 1, 2**7, 2**8 - 1, 2**8, 2**16 - 1, 2**16} <= asked
    assert {10, 11} <= asked
    assert any(not is_asked for _, is_asked in played)


def test_once_a_command_is_refused_and_the_agent_notified():
    notices = [observation.notice for observation in fly(1) if observation.awaiting_command]
    assert notices[REFUSED_QUESTION - 1] is None
    assert "expected a place in free air" in (notices[REFUSED_QUESTION] or "")
    assert notices[REFUSED_QUESTION + 1] is None


def test_a_waypoint_outside_of_the_room_is_refused():
    world = ScriptedWorld(1)
    world.obey(Command(tick=0, kind="waypoint", position_world_m=(ROOM_M[0] + 1.0, 1.0, 1.0)))
    assert world.notice is not None


def test_fields_of_a_later_version_change_nothing_for_who_reads_by_name():
    observation = fly(1)[5]
    later = add_unknown_fields(observation.model_dump())
    assert codec.decode(Observation, msgpack.packb(later)) == observation
    assert later["readings"][0].keys() > observation.model_dump()["readings"][0].keys()
    briefing = codec.decode(Briefing, msgpack.packb(add_unknown_fields(build_briefing(1).model_dump())))
    assert briefing.contract_version.endswith(".99")
