"""Laws that every bundled method keeps: the same commands from the same seed, and none that breaks in a bad hour."""

import io
import math
from functools import cache

import numpy as np
import pytest
from briefings import MODELS, PLUME, briefing, observation, open_map
from PIL import Image

from gslcosim.agent_kit import Agent, Observation
from gslcosim.base.bundled import bundled_agents
from gslcosim.base.errors import MethodError
from gslcosim.contract.messages import CameraImage, Reading
from gslcosim.methods.card import find_card_beside
from gslcosim.runtime.agents.loader import load_python_agent

SIZE_M = (12.0, 9.0, 4.0)
START_M = (8.0, 4.0, 2.0)
SOURCE_M = (3.0, 4.5, 2.0)
UPWIND_RAD = math.pi  # the wind blows to +x
MEMBERS = ("searcher", "second", "third")
# Which sensors a vehicle gets for each kind that a card may ask for.
SENSORS_OF_KIND = {
    "gas": [("pid", "nose"), ("pid", "nose_right", (0.0, -0.25, 0.0))],
    "gas_ppm": [("pid", "nose"), ("pid", "nose_right", (0.0, -0.25, 0.0))],
    "gas_ohm": [("tgs2600", "nose"), ("tgs2600", "nose_right", (0.0, -0.25, 0.0))],
    "wind": [("anemometer", "vane")],
    "range": [("four_range_finders", "ranges")],
    "camera": [("camera", "eye")],
}
NAMES = sorted(bundled_agents())


# Each when it is asked for: a method that cannot be loaded fails its own tests and no others.
@cache
def card_of(name):
    return find_card_beside(bundled_agents()[name])


@cache
def type_of(name):
    return load_python_agent(bundled_agents()[name])


N_QUESTIONS = 12
CALM, GAS = "calm", "gas"


def sensors_for(card) -> list[tuple]:
    """Return sensors that are enough for a card, each name once."""
    found: dict[str, tuple] = {}
    for kind, n in card.needs.sensors.items():
        found |= {item[1]: item for item in SENSORS_OF_KIND[kind][:n]}
    if not any(MODELS[model][0] != "picture" for model, *_ in found.values()):
        found["nose"] = ("pid", "nose")
    return list(found.values())


def briefing_for(card, **changes):
    return briefing(
        **{
            "sensors": sensors_for(card),
            "size_m": SIZE_M,
            "known_map": open_map(SIZE_M[:2]) if "map" in card.needs.knows else None,
            "plume": PLUME if "plume" in card.needs.knows else None,
            "known_sources": (SOURCE_M,) if "source" in card.needs.knows else (),
            "members": MEMBERS if card.needs.radio else (),
            **changes,
        }
    )


class Air:
    """Readings of a room with a smooth plume; `calm` has neither wind nor gas."""

    def __init__(self, sensors, mood=GAS, seed=1):
        self.sensors, self.mood = sensors, mood
        self.noise = np.random.default_rng(seed)

    def readings(self, position_m):
        ppm = 0.0 if self.mood == CALM else 30.0 * math.exp(-math.dist(position_m, SOURCE_M) / 1.5)
        wind = (0.0, 0.0) if self.mood == CALM else (0.4, UPWIND_RAD + 0.1 * self.noise.normal())
        by_quantity = {
            "mixing_ratio": ppm,
            "gas_detected": float(ppm > 0.1),
            "hits": float(round(ppm)),
            "resistance": 50_000.0 / (1.0 + 0.1 * ppm),
            "apparent_wind": wind,
            "range": (SIZE_M[0] - position_m[0], SIZE_M[1] - position_m[1], position_m[0], position_m[1]),
        }
        values = {}
        for model, name, *_ in self.sensors:
            quantity = MODELS[model][0]
            if quantity in by_quantity:
                values[name] = by_quantity[quantity]
            if quantity == "resistance":
                values[f"{name}_ppm"] = ppm
        return values


def picture(reading_less: Observation, names) -> Observation:
    """Add pictures for cameras: grey ones."""
    if not names:
        return reading_less
    file = io.BytesIO()
    Image.new("RGB", (16, 16), (128, 128, 128)).save(file, "PNG")
    image = CameraImage(
        encoding="png", width_px=16, height_px=16, focal_px=12.0, centre_px=(8.0, 8.0),
        position_body_m=(0.1, 0.0, 0.0), quaternion_body_wxyz=(0.5, -0.5, 0.5, -0.5),
        taken_tick=reading_less.tick, data=file.getvalue(),
    )  # fmt: skip
    more = tuple(Reading(sensor=name, quantity="picture", unit="1", values=(), image=image) for name in names)
    return reading_less.model_copy(update={"readings": (*reading_less.readings, *more)})


def fly(name, *, seed=3, mood=GAS, refuse=(), warming=0, heard=(), n_questions=N_QUESTIONS, **changes):
    """Return the commands of an agent that goes wherever it is sent, but for the refused questions."""
    card = card_of(name)
    shown = briefing_for(card, seed=seed, **changes)
    agent: Agent = type_of(name)(shown)
    sensors = sensors_for(card)
    air, position_m, commands, notice, tick = Air(sensors, mood), START_M, [], None, 40
    cameras = [item[1] for item in sensors if MODELS[item[0]][0] == "picture"]
    for i in range(n_questions):
        names = [item[1] for item in sensors if MODELS[item[0]][0] != "picture"]
        for step in range(3):
            seen = picture(
                observation(
                    tick=tick,
                    position_m=position_m,
                    readings=air.readings(position_m),
                    asked=step == 2,
                    notice=notice,
                    warming=names if i < warming else (),
                    heard=heard if step == 0 else (),
                ),
                cameras,
            )
            agent.observe(seen)
            tick += 10
        command = agent.decide(seen)
        assert command.tick == seen.tick
        commands.append(command)
        notice = "the waypoint lies within an obstacle" if i in refuse else None
        if notice is None:
            position_m = moved(position_m, command)
    agent.end("time_limit")
    return commands


def moved(position_m, command):
    target_m = command.position_world_m
    if command.waypoints:
        target_m = command.waypoints[-1].position_world_m
    if command.velocity_world_m_s is not None:
        duration_s = 2.0 if command.hold_s is None else max(command.hold_s, 0.1)
        target_m = tuple(p + duration_s * v for p, v in zip(position_m, command.velocity_world_m_s, strict=True))
    if target_m is None:
        return position_m
    return tuple(min(max(value, 0.2), size - 0.2) for value, size in zip(target_m, SIZE_M, strict=True))


def places_of(command):
    """Return the places that a command sends the vehicle to."""
    waypoints = [waypoint.position_world_m for waypoint in command.waypoints or ()]
    return [*waypoints, *([command.position_world_m] if command.position_world_m else [])]


# Its belief takes seconds where those of the others take tenths.
SLOW = "pmfs_published"

every_method = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name == SLOW else ()) for name in NAMES]
)


@cache
def flight(name):
    return fly(name, n_questions=20)


@every_method
def test_it_keeps_to_the_room_and_answers_every_question(name):
    for command in flight(name):
        for place_m in places_of(command):
            assert all(0.0 < value < size for value, size in zip(place_m, SIZE_M, strict=True)), place_m


@every_method
def test_two_of_a_kind_in_one_process_do_not_disturb_each_other(name):
    """What one remembers is not in the module: a flight in between changes nothing."""
    alone = fly(name, seed=5)
    fly(name, seed=6, mood=CALM)
    assert fly(name, seed=5) == alone


@every_method
@pytest.mark.parametrize("hour", [{"mood": CALM}, {"warming": 4}], ids=["calm air", "warm-up"])
def test_it_survives_an_hour_without_gas_or_sensors(name, hour):
    assert len(fly(name, **hour)) == N_QUESTIONS


@every_method
def test_a_refused_leg_is_not_commanded_again_and_again(name):
    """After a refusal in the open, at least one of the next three commands leads elsewhere."""
    commands = fly(name, refuse=range(2, 6))
    refused = [command for command in commands[2:6] if places_of(command)]
    if len(refused) > 2 and name != "oracle":  # which knows no other place to go to
        assert len({tuple(places_of(command)) for command in refused}) > 1


@every_method
def test_it_survives_garbage_on_the_radio(name):
    if card_of(name).needs.radio:
        texts = ["", "Ω\x00", "{" * 50, "nan nan nan", "1e999 2 3 4 5 6 7", "9" * 900]
        assert len(fly(name, heard=[("second", text) for text in texts])) == N_QUESTIONS


@every_method
def test_it_publishes_beliefs_if_and_only_if_its_card_says_so(name):
    beliefs = [command.belief for command in flight(name) if command.belief is not None]
    assert bool(beliefs) == card_of(name).believes


@every_method
def test_it_never_declares_where_its_card_says_that_it_does_not(name):
    declared = [command for command in flight(name) if command.kind == "declare_source"]
    assert card_of(name).declares or not declared


@every_method
def test_missing_sensors_are_reported_at_the_briefing(name):
    for kind in card_of(name).needs.sensors:
        with pytest.raises(MethodError, match=f"of kind {kind}"):
            type_of(name)(briefing_for(card_of(name), sensors=[]))


@every_method
def test_a_missing_grant_is_reported_at_the_briefing(name):
    for item in card_of(name).needs.knows:
        grant = {"map": "known_map", "plume": "plume", "source": "known_sources"}[item]
        with pytest.raises(MethodError, match=f"{item}: true"):
            type_of(name)(briefing_for(card_of(name), **{grant: () if item == "source" else None}))


@every_method
def test_a_wrong_parameter_is_reported_at_the_briefing(name):
    with pytest.raises(MethodError, match="no_such_parameter"):
        type_of(name)(briefing_for(card_of(name), parameters={"no_such_parameter": 1}))


@every_method
def test_every_parameter_can_be_given(name):
    """Its own default is an allowed value, and each choice starts."""
    for parameter, entry in card_of(name).parameters.items():
        values = entry.choices or ([entry.default] if entry.default is not None else [])
        for value in values:
            type_of(name)(briefing_for(card_of(name), parameters={parameter: value}))
