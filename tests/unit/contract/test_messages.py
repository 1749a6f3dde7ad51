import math

import numpy as np
import pytest
from built_messages import build_body, build_observation
from contract_hash import hash_schemas

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec, keys, messages
from gslcosim.contract.environment_messages import PROBES
from gslcosim.contract.messages import BodyPoses, BodyState, Command, Declaration, Message, Note, Reading, Score
from gslcosim.contract.record import get_pydantic_model
from gslcosim_conformance.message_schemas import list_message_types


def body(agent: str, *, awaiting_command: bool) -> BodyState:
    return build_body(agent, phase="holding", awaiting_command=awaiting_command)


def test_bodies_announce_the_commands_of_the_agents_that_are_asked():
    poses = BodyPoses(tick=1, bodies=(body("a", awaiting_command=True), body("b", awaiting_command=False)))
    assert poses.announced_ports() == {keys.command("a")}


def test_only_a_final_score_announces_the_verdict():
    assert Score(tick=1, agents=()).announced_ports() == frozenset()
    assert Score(tick=1, agents=(), is_final=True).announced_ports() == {keys.VERDICT}


def test_only_a_failed_command_closes_its_port():
    assert Command(tick=1, kind="failed").closes_port
    assert not Command(tick=1, kind="noop").closes_port


def test_messages_are_frozen():
    command = Command(tick=1, kind="noop")
    with pytest.raises(AttributeError, match="immutable"):
        command.tick = 2


@pytest.mark.parametrize("message_type", list_message_types())
def test_every_message_is_frozen_strict_and_open_for_later_keys(message_type):
    config = get_pydantic_model(message_type).model_config
    assert (config["frozen"], config["strict"], config["extra"], config["allow_inf_nan"]) == (
        True,
        True,
        "ignore",
        False,
    )


def test_readings_are_found_by_the_name_of_the_sensor():
    reading = Reading(sensor="nose", quantity="resistance", unit="ohm", values=(1.0,))
    observation = build_observation(agent="a", status="on_ground", awaiting_command=False, readings=(reading,))
    assert observation.reading("nose") is reading
    with pytest.raises(KeyError, match=r"no sensor 'nase'; there are \['nose'\]"):
        observation.reading("nase")


@pytest.mark.parametrize("name", ["", "Beetle", "1st", "a/b", "a*", "a b", "x" * 41, "ä", "a\n"])
def test_names_are_safe_as_parts_of_keys(name):
    with pytest.raises(ValueError, match="pattern"):
        body(name, awaiting_command=False)


def test_the_contract_hash_changes_with_any_message(monkeypatch):
    class Extra(Message):
        value: float

    before = hash_schemas(list_message_types())
    monkeypatch.setattr(messages, "Extra", Extra, raising=False)
    assert hash_schemas(list_message_types()) != before


def test_what_agents_may_see_is_never_under_truth():
    for function in (keys.briefing, keys.observation, keys.raw_command, keys.ending):
        assert function("beetle").startswith("agents/beetle/")
    assert all(key.startswith("truth/") for key in (keys.BODIES, keys.SAMPLES, keys.FILAMENTS, PROBES))


def test_a_note_is_sent_and_its_absence_leaves_no_trace():
    """What an agent without notes writes has the bytes that it had before there were any."""
    plain = Command(tick=1, kind="noop")
    assert b"note" not in codec.encode(plain)
    assert "note" not in plain.model_dump()
    noted = plain.model_copy(update={"note": Note(mode="casting", values={"entropy_bits": 2.5})})
    assert codec.decode(Command, codec.encode(noted)) == noted
    assert codec.decode_json(Command, codec.encode_json(noted)) == noted
    assert codec.decode(Command, codec.encode(plain)).note is None


@pytest.mark.parametrize(
    ("note", "bound"),
    [({"mode": "x" * 41}, "at most 40"), ({"values": {f"a{i}": 1.0 for i in range(17)}}, "at most 16"),
     ({"values": {"a": math.inf}}, "finite")],
)  # fmt: skip
def test_a_note_that_is_too_long_is_refused_with_its_bound(note, bound):
    with pytest.raises(ContractError, match=bound):
        codec.build_message(Command, {"tick": 1, "kind": "noop", "note": note})


def test_numpy_and_lists_are_taken_for_positions():
    place = np.array([1, 2, 3.5], np.float32)
    for given in (place, place.tolist(), tuple(place), [np.float64(1.0), 2, 3.5]):
        assert Command(tick=np.int64(4), kind="waypoint", position_world_m=given).position_world_m == (1.0, 2.0, 3.5)
    assert codec.encode(Declaration(position_world_m=place)) == codec.encode(
        Declaration(position_world_m=(1.0, 2.0, 3.5))
    )
    with pytest.raises(ValueError, match=r"Command: position_world_m\[2\]: expected .*"):
        Command(tick=4, kind="waypoint", position_world_m=place[:2])


@pytest.mark.parametrize(
    ("keyword", "nearest"), [("position_m", "position_world_m"), ("velocity", "velocity_world_m_s"), ("yaw", "yaw_rad"),
                             ("knd", "kind")],
)  # fmt: skip
def test_a_wrong_keyword_is_an_error_with_the_nearest(keyword, nearest):
    with pytest.raises(TypeError, match=f"was the keyword '{keyword}'. Did you mean {nearest}?"):
        Command(**{"tick": 1, "kind": "hold", keyword: 1.0})
