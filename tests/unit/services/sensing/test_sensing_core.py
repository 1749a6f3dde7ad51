import math

import pytest
from built_messages import build_body, build_sample
from built_scenarios import build_agent, build_scenario

from gslcosim.base.errors import ModelError, ScenarioError
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import (
    BodyPoses,
    FieldSamples,
    GasAmount,
    RadioArrival,
    RadioMessage,
    RadioReception,
    RadioTraffic,
    RadioTransmission,
    Task,
)
from gslcosim.contract.participant import Episode
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.serialization import plain_values
from gslcosim_services.sensing.core import SensingCore, mount_velocity_world_m_s

YAW_90 = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


def body(agent="beetle", **changes):
    moving = {"quaternion_wxyz": YAW_90, "velocity_world_m_s": (0.5, 0.0, 0.1), "path_length_m": 7.0}
    asked = {"phase": "holding", "awaiting_command": True}
    return build_body(agent, (1.0, 2.0, 3.0), **{**moving, **asked, **changes})


def inbox(tick, agents=("beetle", "moth"), sensors=("nose", "wind"), **changes):
    samples = tuple(build_sample(a, s, wind_m_s=(-1.0, 0.0, 0.0), ethanol=5.0) for a in agents for s in sensors)
    return {
        keys.BODIES: BodyPoses(tick=tick, bodies=tuple(body(agent, **changes) for agent in agents)),
        keys.SAMPLES: FieldSamples(tick=tick, samples=samples),
    }


@pytest.fixture
def scenario():
    """Two agents with a nose and an anemometer each."""
    sensors = [
        {"model": "tgs2600_ideal", "name": "nose", "mount_m": (0.2, 0.0, 0.0)},
        {"model": "anemometer_ideal", "name": "wind", "speed_noise_std_m_s": 0.0, "direction_noise_std_rad": 0.0},
    ]
    return build_scenario(
        *(build_agent(name, sensors=sensors) for name in ("beetle", "moth")),
        gas={"sources": [{"position_m": (5.125, 1.375, 2.0)}]},
        referee={"success": {"within_m": 0.75}, "stop": {"time_limit_s": 120}},
    )


@pytest.fixture
def core(scenario, make_room):
    return SensingCore(scenario, make_room())


def test_each_agent_is_briefed_once(core, scenario):
    briefings = core.reset(Episode(seed=3))
    assert set(briefings) == {keys.briefing("beetle"), keys.briefing("moth")}
    briefing = briefings[keys.briefing("beetle")]
    assert (briefing.tick, briefing.tick_ns, briefing.mode, briefing.latency_ticks) == (0, 100_000_000, "on_request", 1)
    assert (briefing.bounds.min_m, briefing.bounds.max_m) == ((0.0, 0.0, 0.0), (15.0, 10.0, 6.0))
    assert [(s.name, s.model, s.quantity, s.unit) for s in briefing.sensors] == [
        ("nose", "tgs2600", "resistance", "ohm"),
        ("wind", "anemometer", "apparent_wind", "m/s, rad"),
        ("nose_ppm", "tgs2600", "estimated_mixing_ratio", "ppm"),
    ]
    assert briefing.sensors[0].mount_body_m == (0.2, 0.0, 0.0)
    assert {w.port for w in core.spec.writes if w.announced_in == "once"} == set(briefings)


def test_a_briefing_has_the_task_as_fields_and_as_a_sentence(core):
    briefing = core.reset(Episode(seed=3))[keys.briefing("moth")]
    assert briefing.task == Task(goal="source", success_radius_m=0.75, time_limit_s=120.0, distance_of="vehicle")
    assert briefing.mission == "Find the source of ethanol in the room: come within 0.75 m of it in at most 120 s."


def test_a_briefing_does_not_show_where_the_source_is(core):
    for briefing in core.reset(Episode(seed=3)).values():
        assert "5.125" not in str(briefing)
        assert "1.375" not in str(briefing)


def test_agents_seeds_differ_from_each_other_and_from_the_runs(core):
    seeds = [core.reset(Episode(seed=seed))[keys.briefing(a)].seed for seed in (3, 4) for a in ("beetle", "moth")]
    assert len({*seeds, 3, 4}) == 6


def test_an_observation_shows_pose_state_and_readings(core):
    core.reset(Episode(seed=3))
    core.step(0, inbox(0))
    observation = core.step(1, inbox(1, rejected_command="too far"))[keys.observation("moth")]
    assert (observation.tick, observation.agent, observation.time_s) == (1, "moth", 0.1)
    assert observation.position_world_m == (1.0, 2.0, 3.0)
    assert observation.yaw_rad == pytest.approx(math.pi / 2)
    assert (observation.status, observation.awaiting_command, observation.notice) == ("holding", True, "too far")
    assert [r.sensor for r in observation.readings] == ["nose", "wind", "nose_ppm"]
    assert observation.reading("nose").values[0] < 50000.0
    assert observation.reading("wind").values == pytest.approx((1.5, 0.0))


def test_a_mount_swings_with_the_turning_vehicle():
    turning = body(angular_velocity_body_rad_s=(0.0, 0.0, 2.0))
    assert mount_velocity_world_m_s(turning, (0.5, 0.0, 0.0)) == pytest.approx((0.5 - 1.0, 0.0, 0.1))
    assert mount_velocity_world_m_s(turning, (0.0, 0.0, 0.0)) == (0.5, 0.0, 0.1)
    rolling = body(angular_velocity_body_rad_s=(3.0, 0.0, 0.0), velocity_world_m_s=(0.0, 0.0, 0.0))
    assert mount_velocity_world_m_s(rolling, (0.0, 0.0, 0.1)) == pytest.approx((0.3, 0.0, 0.0))


def test_equal_seeds_give_equal_messages_and_another_seed_others(scenario, make_room):
    noisy = plain_values(scenario)
    noisy["agents"][0]["sensors"][1]["speed_noise_std_m_s"] = 0.1

    def encoded(seed):
        core = SensingCore(Scenario.model_validate(noisy), make_room())
        core.reset(Episode(seed=seed))
        return [codec.encode(m) for tick in range(5) for m in core.step(tick, inbox(tick)).values()]

    assert encoded(3) == encoded(3)
    assert encoded(3) != encoded(4)


def test_reset_switches_the_instruments_on_again(core):
    core.reset(Episode(seed=3))
    first = [core.step(tick, inbox(tick)) for tick in range(5)]
    core.reset(Episode(seed=3))
    assert [core.step(tick, inbox(tick)) for tick in range(5)] == first


def test_missing_poses_and_samples_are_named(core):
    core.reset(Episode(seed=3))
    with pytest.raises(ModelError, match="pose of vehicle 'moth' in tick 0"):
        core.step(0, inbox(0, agents=("beetle",)))
    with pytest.raises(ModelError, match=r"sample for beetle\.wind in tick 0"):
        core.step(0, inbox(0, sensors=("nose",)))


def test_an_unknown_model_is_refused(scenario, make_room):
    strange = [
        agent.model_copy(update={"sensors": (agent.sensors[0].model_copy(update={"model": "e_nose"}),)})
        for agent in scenario.agents
    ]
    with pytest.raises(ScenarioError, match=r"model: expected one of .* was 'e_nose'"):
        SensingCore(scenario.model_copy(update={"agents": tuple(strange)}), make_room())


def test_each_agent_receives_what_comes_to_it_and_is_reported_of_its_refusals(scenario, make_room):
    fields = plain_values(scenario)
    fields["channels"] = [{"name": "radio", "range_m": 5.0}, {"name": "far"}]
    core = SensingCore(Scenario.model_validate(fields), make_room())
    briefing = core.reset(Episode(seed=1))[keys.briefing("moth")]
    assert [(c.name, c.members, c.range_m) for c in briefing.channels] == [
        ("radio", ("beetle", "moth"), 5.0),
        ("far", ("beetle", "moth"), None),
    ]
    reception = RadioReception(sender="beetle", channel="radio", text="here", sent_tick=0)
    too_long = RadioTransmission(
        sender="beetle", message=RadioMessage(channel="radio", text="x"), refusal="outgoing[0].text: too long."
    )
    traffic = RadioTraffic(
        tick=1, transmissions=(too_long,), arrivals=(RadioArrival(agent="moth", reception=reception),)
    )
    observations = core.step(1, {**inbox(1), keys.RADIO: traffic})
    beetle, moth = observations[keys.observation("beetle")], observations[keys.observation("moth")]
    assert (beetle.incoming, beetle.radio_refusals) == ((), ("outgoing[0].text: too long.",))
    assert (moth.incoming, moth.radio_refusals) == ((reception,), ())


def test_the_estimate_is_that_of_a_unit_that_was_calibrated_in_clean_air(scenario, make_room):
    values = plain_values(scenario)
    values["agents"][0]["sensors"][0]["gain_spread"] = 0.3
    core = SensingCore(Scenario.model_validate(values), make_room())
    last = {}
    for seed in (3, 4):
        core.reset(Episode(seed=seed))
        for tick in range(1500):
            last[seed] = core.step(tick, inbox(tick))[keys.observation("beetle")]
    ohms = [observation.reading("nose").values[0] for observation in last.values()]
    assert abs(ohms[0] - ohms[1]) > 0.02 * ohms[0]
    for observation in last.values():
        assert observation.reading("nose_ppm").values[0] == pytest.approx(5.0, rel=1e-5)


def test_a_gas_of_ones_own_is_noticed_as_the_scenario_says(scenario, make_room):
    plain = plain_values(scenario)
    plain["gas"] |= {
        "gas": "freon",
        "define": [
            {"name": "freon", "specific_gravity": 3.0, "pid_correction": 2.5,
             "mox": [{"sensor": "tgs2600", "a": 1.0, "b": -0.5}]}
        ],
    }  # fmt: skip
    nose = plain["agents"][0]["sensors"][0]
    plain["agents"][0]["sensors"] = [nose, {"model": "pid_ideal", "name": "wind"}]
    core = SensingCore(Scenario.model_validate(plain), make_room())
    core.reset(Episode(seed=3))
    for tick in range(1500):
        box = inbox(tick)
        samples = tuple(
            s.model_copy(update={"gases": (GasAmount(gas="freon", mixing_ratio_ppm=4.0),)})
            for s in box[keys.SAMPLES].samples
        )
        box[keys.SAMPLES] = FieldSamples(tick=tick, samples=samples)
        observation = core.step(tick, box)[keys.observation("beetle")]
    assert observation.reading("nose").values[0] == pytest.approx(25000.0, rel=1e-6)
    assert observation.reading("nose_ppm").values[0] == pytest.approx(4.0, rel=1e-5)
    assert observation.reading("wind").values == (1.6,)


def test_on_board_sensors_need_no_samples_and_a_pose_is_what_the_agent_gets(make_room):
    sensors = [
        {"model": "pose", "name": "pose", "pose": {"position_noise_m": 0.5}},
        {"model": "lidar_2d", "name": "scan", "period_s": 0.2},
    ]
    core = SensingCore(build_scenario(build_agent(sensors=sensors)), make_room())
    briefing = core.reset(Episode(seed=1))[keys.briefing("beetle")]
    assert briefing.sensors[1].directions_body.shape == (1, 360, 3)
    arrays = []
    for tick, is_asked in enumerate((False, False, False, True)):
        observation = core.step(tick, inbox(tick, ("beetle",), (), awaiting_command=is_asked))[
            "agents/beetle/observation"
        ]
        pose = observation.reading("pose").values
        assert observation.position_world_m == pose[:3] != (1.0, 2.0, 3.0)
        assert observation.velocity_world_m_s == pose[7:]
        arrays.append(observation.reading("scan").array)
    assert [array is not None for array in arrays] == [True, False, True, True]
    assert arrays[3] == arrays[2]
