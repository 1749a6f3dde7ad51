import math

import numpy as np
import pytest
from built_messages import build_body, build_poses
from built_scenarios import build_agent, build_scenario

from gslcosim.base.errors import GslCosimError, ModelError
from gslcosim.contract import codec, keys
from gslcosim.contract.environment_messages import PROBES
from gslcosim.contract.participant import Episode
from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.serialization import plain_values
from gslcosim_services.fields.core import SLICE_CUTOFF_SIGMA, FieldsCore
from gslcosim_services.fields.mixing_ratio import Walls, mixing_ratio_ppm_at

YAW_90 = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


@pytest.fixture
def room(make_room):
    """The shared test room with a slight cross wind."""
    return make_room(wind_m_s=((0.3, 0.1, 0.0),))


@pytest.fixture
def scenario_with():
    """Build a scenario of one vehicle with a nose ahead of it, an anemometer above it and a second nose."""

    def build(*, search_heights_m=(2.0,), recording=None, **gas):
        sensors = [
            {"model": "tgs2600", "name": "nose", "mount_m": (0.4, 0.0, 0.0)},
            {"model": "anemometer", "name": "wind", "mount_m": (0.0, 0.0, 0.1)},
            {"model": "tgs2600", "name": "twin", "mount_m": (0.4, 0.0, 0.0)},
        ]
        agents = [
            build_agent(f"agent_{i}", sensors=sensors, vehicle={"search_height_m": height_m})
            for i, height_m in enumerate(search_heights_m)
        ]
        gas = {"sources": [{"position_m": (5.0, 5.0, 2.0)}], "warm_up_s": 20.0, **gas}
        return build_scenario(*agents, seed=3, gas=gas, recording=recording or {})

    return build


def bodies(tick, position_m=(6.0, 5.3, 2.0), quaternion=(1.0, 0.0, 0.0, 0.0), agents=("agent_0",)):
    poses = build_poses(tick, *(build_body(agent, position_m, quaternion_wxyz=quaternion) for agent in agents))
    return {keys.BODIES: poses}


def started(scenario, room):
    core = FieldsCore(scenario, room)
    core.reset(Episode(seed=3))
    return core


def run(core, n_ticks, seed=3):
    core.reset(Episode(seed=seed))
    return [core.step(tick, bodies(tick)) for tick in range(n_ticks)]


def test_writes_samples_every_tick_and_clouds_at_their_period(scenario_with, room):
    core = FieldsCore(scenario_with(recording={"gas_every_s": 0.5}), room)
    outboxes = run(core, 12)
    assert all(keys.SAMPLES in outbox for outbox in outboxes)
    assert [tick for tick, outbox in enumerate(outboxes) if keys.FILAMENTS in outbox] == [0, 5, 10]
    assert {write.port for write in core.spec.writes} == {keys.SAMPLES, keys.FILAMENTS}


@pytest.mark.parametrize("tick_ms", [20, 100, 200])
def test_the_length_of_the_tick_does_not_change_the_gas(scenario_with, room, tick_ms):
    places_m, ppm = [], []
    for ms in (100, tick_ms):
        plain = plain_values(scenario_with(eddy_diffusivity_m2_s=0.01))
        core = FieldsCore(Scenario.model_validate(plain | {"tick_ms": ms}), room)
        samples = run(core, 2000 // ms + 1)[-1][keys.SAMPLES].samples
        places_m.append(core.gas.filaments.position_world_m.copy())
        ppm.append([sample.gases[0].mixing_ratio_ppm for sample in samples])
    np.testing.assert_array_equal(*places_m)
    np.testing.assert_allclose(*ppm, rtol=1e-12)
    assert min(ppm[0]) > 0.01


def test_samples_are_the_fields_at_each_turned_mount(scenario_with, room):
    core = started(scenario_with(), room)
    samples = core.step(0, bodies(0, quaternion=YAW_90))[keys.SAMPLES].samples
    nose_m = np.array([[6.0, 5.3 + 0.4, 2.0]])
    expected = mixing_ratio_ppm_at(nose_m, core.gas.filaments, walls=Walls.of(room))[0, 0]
    assert [(s.agent, s.sensor) for s in samples] == [("agent_0", n) for n in ("nose", "wind", "twin")]
    assert samples[0].gases[0].gas == "ethanol"
    assert samples[0].gases[0].mixing_ratio_ppm == pytest.approx(expected, rel=1e-6)
    assert expected > 0.1
    assert samples[2].gases == samples[0].gases
    wind = trilinear_wind(room.wind.velocity_m_s[0], room.grid.origin_m, room.grid.cell_m, 6.0, 5.3, 2.1)
    assert samples[1].wind_world_m_s == pytest.approx(wind)


def test_many_vehicles_are_sampled_as_one_is(scenario_with, room):
    agents = tuple(f"agent_{i}" for i in range(4))
    core = started(scenario_with(search_heights_m=(2.0,) * 4), room)
    for tick in range(3):
        samples = core.step(tick, bodies(tick, agents=agents))[keys.SAMPLES].samples
        nose_m = np.array([[6.4, 5.3, 2.0]])
        expected = mixing_ratio_ppm_at(nose_m, core.gas.filaments, walls=Walls.of(room))[0, 0]
        found = [s.gases[0].mixing_ratio_ppm for s in samples if s.sensor == "nose"]
        assert found == pytest.approx([expected] * 4, rel=1e-12)


def test_wind_samples_follow_the_frame_of_the_plumes_time(scenario_with, make_room):
    room = make_room(wind_m_s=((0.1, 0.0, 0.0), (0.2, 0.0, 0.0)), period_s=0.3)
    core = FieldsCore(scenario_with(warm_up_s=0.5), room)
    winds = [outbox[keys.SAMPLES].samples[0].wind_world_m_s[0] for outbox in run(core, 5)]
    assert winds == pytest.approx([0.2, 0.1, 0.1, 0.1, 0.2])


def test_a_gas_step_of_several_ticks_rests_between_them(scenario_with, room):
    core = started(scenario_with(step_s=0.2), room)
    steps = []
    for tick in range(5):
        core.step(tick, bodies(tick))
        steps.append(core.gas.step)
    assert steps == [100, 100, 101, 101, 102]


def test_clouds_show_place_size_and_gas_of_every_filament(scenario_with, room):
    core = FieldsCore(scenario_with(), room)
    cloud = run(core, 1)[0][keys.FILAMENTS]
    assert cloud.gases == ("ethanol",)
    assert cloud.position_world_m.shape == (len(core.gas.filaments.sigma_m), 3)
    np.testing.assert_allclose(cloud.position_world_m.to_array(), core.gas.filaments.position_world_m, rtol=1e-6)
    np.testing.assert_allclose(cloud.sigma_m.to_array(), core.gas.filaments.sigma_m, rtol=1e-6)
    assert cloud.gas_index.to_array().tolist() == [0] * len(core.gas.filaments.sigma_m)


def test_slices_are_the_field_at_cell_centres_of_the_search_height(scenario_with, room):
    core = started(scenario_with(search_heights_m=(2.3,), recording={"slice_cell_m": 0.4}), room)
    found = core.step(0, bodies(0))[keys.FILAMENTS].slices[0]
    ppm = found.mixing_ratio_ppm.to_array()
    assert ppm.shape == (38, 25)
    i, j = np.unravel_index(ppm.argmax(), ppm.shape)
    centre = np.array([[0.4 * (i + 0.5), 0.4 * (j + 0.5), 2.3]])
    assert ppm[i, j] == pytest.approx(
        mixing_ratio_ppm_at(centre, core.gas.filaments, cutoff_sigma=SLICE_CUTOFF_SIGMA)[0, 0], rel=1e-6
    )
    assert (found.origin_m, found.cell_m, found.height_m) == ((0.0, 0.0), 0.4, 2.3)


def test_the_slice_is_at_the_sources_height_when_agents_disagree(scenario_with):
    assert scenario_with(search_heights_m=(3.0, 3.0)).slice_height_m == 3.0
    assert scenario_with(search_heights_m=(1.0, 3.0)).slice_height_m == 2.0


def test_equal_seeds_give_equal_messages_and_another_seed_others(scenario_with, room):
    def encoded(seed):
        core = FieldsCore(scenario_with(), room)
        return [codec.encode(m) for outbox in run(core, 12, seed) for _, m in sorted(outbox.items())]

    assert encoded(3) == encoded(3)
    assert encoded(3) != encoded(4)


def test_ends_of_the_room_are_sampled_without_harm(scenario_with, room):
    core = started(scenario_with(), room)
    for tick, place in enumerate([(0.0, 0.0, 0.0), (15.0, 10.0, 6.0), (-3.0, 50.0, 2.0)]):
        assert core.step(tick, bodies(tick, place))[keys.SAMPLES].samples[0].gases[0].mixing_ratio_ppm >= 0.0


def test_a_missing_vehicle_is_named(scenario_with, room):
    core = started(scenario_with(), room)
    with pytest.raises(ModelError, match="expected a pose of vehicle 'agent_0' in tick 0, was none"):
        core.step(0, bodies(0, agents=("stranger",)))


def test_wind_that_is_not_finite_stops_the_run(scenario_with, room):
    core = started(scenario_with(warm_up_s=0.0), room)
    room.wind.velocity_m_s[..., 2] = math.nan
    with pytest.raises(ModelError, match="not finite in tick 0"):
        core.step(0, bodies(0))


def test_a_snapshot_period_that_is_no_whole_number_of_ticks_is_refused(scenario_with, room):
    with pytest.raises(GslCosimError, match=r"recording\.gas_every_s"):
        FieldsCore(scenario_with(recording={"gas_every_s": 0.25}), room)


def test_every_gas_is_sampled_and_sliced(scenario_with, room):
    sources = [{"position_m": (5.0, 5.0, 2.0)}, {"position_m": (5.0, 5.2, 2.0), "gas": "methane", "ppm": 50.0}]
    core = started(scenario_with(sources=sources), room)
    outbox = core.step(0, bodies(0))
    amounts = outbox[keys.SAMPLES].samples[0].gases
    assert [a.gas for a in amounts] == ["ethanol", "methane"]
    assert all(a.mixing_ratio_ppm > 0.1 for a in amounts)
    cloud = outbox[keys.FILAMENTS]
    assert cloud.gases == ("ethanol", "methane")
    assert np.bincount(cloud.gas_index.to_array()).tolist() == [200, 200]
    assert [s.gas for s in cloud.slices] == ["ethanol", "methane"]


def test_a_warm_up_run_leaves_the_gas_warm_up_out_and_a_run_does_not(scenario_with, room):
    core = FieldsCore(scenario_with(warm_up_s=20.0), room)
    core.reset(Episode(seed=1, is_warmup=True))
    assert core.gas.step == 1
    core.reset(Episode(seed=1))
    assert core.gas.time_s == pytest.approx(20.0)


def test_probes_have_the_gas_and_wind_of_their_points_and_change_nothing_else(room, scenario_with):
    places_m = ((6.0, 5.3, 2.0), (5.4, 5.1, 2.0), (1.0, 9.0, 4.0))
    probes = [{"name": f"probe_{i}", "position_m": position_m} for i, position_m in enumerate(places_m)]
    plain = scenario_with()
    probed = Scenario.model_validate({**plain_values(plain), "probes": probes})
    core, without = FieldsCore(probed, room), FieldsCore(plain, room)
    for outbox, others in zip(run(core, 12), run(without, 12), strict=True):
        assert [*outbox] == [*others, PROBES]
        assert [codec.encode(outbox[port]) for port in others] == [codec.encode(others[port]) for port in others]
    message = outbox[PROBES]
    assert (message.tick, [sample.probe for sample in message.samples]) == (11, ["probe_0", "probe_1", "probe_2"])
    points_m = np.array(places_m)
    found_ppm = [[amount.mixing_ratio_ppm for amount in sample.gases] for sample in message.samples]
    assert found_ppm == core.compute_gas_ppm(points_m).tolist()
    assert found_ppm[1][0] > 0.0
    found_m_s = [list(sample.wind_world_m_s) for sample in message.samples]
    assert found_m_s == core.compute_wind_m_s(points_m, 11).tolist()
    np.testing.assert_allclose(found_m_s, np.tile((0.3, 0.1, 0.0), (3, 1)), rtol=1e-6)
