"""Searches of a batch are single runs with the same case, seed and actions, to the bit."""

from dataclasses import replace

import gsl_bench_writers as gsl_bench
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv

from gslcosim.base.errors import UsageError
from gslcosim_search.learned.encoding import ObservationVector
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models import SensorKernel
from gslcosim_services.sensing.models.gas_sensors import measure_pid
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.search_env import SearchEnv
from gslcosim_training.stepped_run import LearningTask, SteppedRun

# The first one may have to compile the kernels, on a busy machine.

FIGURES = ("distance_to_source_m", "path_length_m", "n_commands", "time_s")
HOLONOMIC = ("agents[0].vehicle.model=holonomic", "agents[0].vehicle.avoidance=none")
PUFFS = (*HOLONOMIC, "gas.turbulence.kind=none")
BALL = (*HOLONOMIC, "gas.model=gaussian_plume")
MEANDERS = ("gas.model=meandering_plume", "gas.plume.meander_s=4")
LIMIT = "referee.stop.time_limit_s=8"
EVERY_SENSOR = (
    "agents[0].sensors=["
    "{model: tgs2600, name: nose, delay_s: 0.4, noise_std: 200, period_s: 0.2, warm_up_s: 2.5, mount_m: [0.1, 0, 0.1]},"
    "{model: pid, name: pid, bias: 0.1, drift_per_s: 0.01, max_value: 3},"
    "{model: threshold, name: threshold, noise_std: 0.2, threshold_ppm: 0.05},"
    "{model: binary, name: binary, noise_std: 0.5},"
    "{model: hit_counter, name: hits, period_s: 1.0, hits_per_s_per_ppm: 8, delay_s: 0.3},"
    "{model: averaging, name: mean}, {model: second_order, name: slow, delay_s: 0.1},"
    "{model: anemometer_3d, name: wind3, noise_std: 0.1, delay_s: 0.2}, {model: anemometer, name: wind},"
    "{model: four_range_finders, name: four, noise_std: 0.05, max_range_m: 4},"
    "{model: range_finder, name: one, beam_body: [1, 0.3, 0.1], max_range_m: 3},"
    "{model: bump, name: bump, period_s: 0.5}, {model: tgs2602, name: nose2}]"
)
# What is around is seen by lidars of one level and of several, whose rays are no whole number of sectors.
LIDARS = (
    "agents[0].sensors=[{model: pid, name: nose, mount_m: [0.1, 0.05, 0]},"
    "{model: lidar_2d, name: scan, period_s: 0.7, lidar: {n_azimuths: 50}, max_range_m: 6},"
    "{model: lidar_3d, name: cloud, noise_std: 0.02, mount_m: [0.02, 0.1, 0.1], mount_rpy_rad: [0.1, 0.2, 0.3],"
    " lidar: {n_azimuths: 37, n_elevations: 3}},"
    "{model: lidar_2d, name: few, warm_up_s: 1.1, period_s: 0.4, noise_std: 0.1, lidar: {n_azimuths: 5}},"
    "{model: range_finder, name: one, beam_body: [1, 0.3, 0.1], max_range_m: 3, noise_std: 0.02}]"
)
TWO_GASES = (
    "gas.sources=[{position_m: [1.5, 2, 1], filaments_per_s: 10},"
    "{position_m: [2.5, 4, 1.2], filaments_per_s: 5, gas: methane}]"
)
# A search is run thrice in a batch: at the beginning, in the middle and at the end.
COPIES = 3


def drawn_actions(space, rng, n, drift):
    """Return n actions."""
    if not space.shape:
        return rng.integers(0, space.n, n)
    numbers = rng.uniform(-1, 1, (n, *space.shape)) + np.resize(drift, space.shape)
    return np.clip(numbers, -1, 1).astype(np.float32)


def assert_equal_flights(scenario, overrides, seeds, *, drift=(0.0, 0.0), n_threads=2, most_steps=400, **settings):
    """Fly each seed alone and in a batch; return the outcomes."""
    settings = {"action": "velocity", **settings}
    task = LearningTask(scenario=scenario, overrides=overrides)
    n = len(seeds)
    batch = BatchSearchEnv([task.loaded(s) for s in seeds], n * COPIES, n_threads=n_threads, **settings)
    alone = [SearchEnv(scenario, overrides=overrides, **settings) for _ in seeds]
    chosen = {"cases": np.tile(np.arange(n), COPIES), "seeds": np.tile(seeds, COPIES)}
    observations, infos = batch.reset(seed=1, options=chosen)
    for i, (env, seed) in enumerate(zip(alone, seeds, strict=True)):
        observation, info = env.reset(seed=seed)
        for j in range(i, n * COPIES, n):
            assert np.array_equal(observations[j], observation), batch.observation_names
            assert {key: infos[key][j] for key in FIGURES} == {key: info[key] for key in FIGURES}
    rng = np.random.default_rng(5)
    outcomes = [None] * n
    for _ in range(most_steps):
        actions = drawn_actions(batch.single_action_space, rng, n, drift)
        observations, rewards, terminated, truncated, infos = batch.step(np.concatenate([actions] * COPIES))
        for i, env in enumerate(alone):
            if outcomes[i] is not None:
                continue
            observation, reward, is_terminated, is_truncated, info = env.step(actions[i])
            for j in range(i, n * COPIES, n):
                assert np.array_equal(observations[j], observation), (j, info)
                assert (rewards[j], terminated[j], truncated[j]) == (reward, is_terminated, is_truncated)
                assert {key: infos[key][j] for key in FIGURES} == {key: info[key] for key in FIGURES}
                if is_terminated or is_truncated:
                    assert (infos["outcome"][j], infos["success"][j]) == (info["outcome"], info["success"])
                    outcomes[i] = info["outcome"]
        if all(outcomes):
            break
    batch.close()
    for env in alone:
        env.close()
    return outcomes


@pytest.mark.slow
def test_velocities_on_request_are_those_of_single_runs():
    overrides = (*BALL, "referee.stop.time_limit_s=15")
    outcomes = assert_equal_flights("tiny_room", overrides, [1, 2, 3], hold_s=0.5)
    assert outcomes == ["time_limit"] * 3
    found = assert_equal_flights("tiny_room", BALL, [1, 2], hold_s=0.5, speed_m_s=0.5, drift=(-0.5, -0.05), n_threads=1)
    assert found == ["success"] * 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "settings"),
    [
        ((*BALL, LIMIT, "agents[0].mode=lockstep"), {}),
        ((*BALL, LIMIT, "agents[0].mode=lockstep"), {"action": "heading", "step_m": 2.0}),
        ((*PUFFS, LIMIT, "agents[0].mode=lockstep"), {"action": "waypoint"}),
        ((*PUFFS, LIMIT), {"hold_s": 0.5, "reward": "sparse"}),
        ((*BALL, LIMIT), {"hold_s": 0.2, "action": "heading", "step_m": 0.7}),
        ((*BALL, *MEANDERS, LIMIT), {"hold_s": 0.5}),
        ((*BALL, *MEANDERS, LIMIT, TWO_GASES, "gas.seed=9", "gas.step_s=0.2"), {"hold_s": 0.5}),
        ((*PUFFS, LIMIT, EVERY_SENSOR), {"hold_s": 0.5}),
        ((*PUFFS, LIMIT, "gas.step_s=0.4"), {"hold_s": 0.5}),
        ((*PUFFS, LIMIT, EVERY_SENSOR, TWO_GASES, "gas.step_s=0.5"), {"hold_s": 0.5}),
        ((*PUFFS, LIMIT, LIDARS), {"hold_s": 0.5}),
        ((*BALL, LIMIT, LIDARS, "agents[0].mode=lockstep"), {}),
        ((*PUFFS, LIMIT, TWO_GASES.replace(", gas: methane", ""), "referee.success.of=all_sources"), {"hold_s": 0.5}),
        ((*BALL, LIMIT, "agents[0].vehicle.start_m=[4.5,2.5,1.5]"), {"hold_s": 0.5, "action": "waypoint_3d"}),
    ],
)
def test_runs_are_those_of_single_runs(overrides, settings):
    """Questions at each tick, legs, filaments, every sensor, several gases and sources, a start in the air."""
    assert assert_equal_flights("tiny_room", overrides, [4, 5], **settings) == ["time_limit"] * 2


def _write_movie(folder, rng, shape):
    ppm = rng.exponential(20.0, (7, *shape)).astype(np.float32)
    np.savez(
        folder / "film.npz", time_s=0.9 * np.arange(1, 8), mixing_ratio_ppm=ppm, origin_m=np.array([0.4, 0.3, 0.1]),
        cell_m=np.array(0.35),
    )  # fmt: skip
    return folder / "film.npz"


# Frame 2 is missing: frame 1 stays. Some are behind the walls of the room.
def _write_filaments(folder, rng, _shape):
    for number in (1, 3, 4):
        positions_m = rng.uniform((-1.4, 1.6, 0.1), (2.9, 4.9, 2.9), (1000, 3))
        sigmas_cm = rng.uniform(8, 40, 1000)
        source_m = (1.5, 2.0, 1.0)
        gsl_bench.write_frame(
            folder, number=number, positions_m=positions_m, sigmas_cm=sigmas_cm, source_m=source_m, gas_code=0
        )
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("write", "shape"), [(_write_movie, (14, 12, 6)), (_write_movie, (14, 12)), (_write_filaments, None)]
)
def test_stored_gas_is_that_of_single_runs(write, shape, tmp_path):
    """Grids, planes and filaments, from before the first frame until time loops."""
    path = write(tmp_path, np.random.default_rng(6), shape)
    overrides = (
        *HOLONOMIC, LIMIT, "gas.model=playback", f"gas.playback={{folder: {path}, loop: true}}",
        "gas.sources=[{position_m: [1.5, 2, 1]}]", "gas.warm_up_s=0", "gas.step_s=0.2",
        "agents[0].vehicle.start_m=[3, 2.5, 0.2]",
        "agents[0].sensors=[{model: pid_ideal, name: nose}, {model: pid, name: arm, mount_m: [0.3, 0.2, 0.1]},"
        "{model: tgs2600, name: mox, mount_m: [-0.2, 0, 0]}]",
    )  # fmt: skip
    assert assert_equal_flights("tiny_room", overrides, [4, 5], hold_s=0.5) == ["time_limit"] * 2
    batch = BatchSearchEnv([LearningTask(scenario="tiny_room", overrides=overrides).loaded(1)], 2, hold_s=0.5)
    i = batch.observation_names.index("nose.amount")
    amounts = [batch.reset(seed=1)[0][0, i]]
    amounts += [batch.step(np.zeros((2, 2), np.float32))[0][0, i] for _ in range(10)]
    batch.close()
    assert max(amounts) > 0.1


@pytest.mark.slow
def test_collisions_are_those_of_single_runs_to_the_last_observation():
    overrides = (*BALL, "referee.stop.time_limit_s=60", "agents[0].vehicle.search_height_m=1")
    outcomes = assert_equal_flights("warehouse_racks", overrides, [1, 4], hold_s=1.0)
    assert outcomes == ["collision"] * 2


@pytest.mark.slow
def test_what_lidars_show_at_a_collision_is_what_a_single_run_shows():
    """Turned by the contact, between two scans, and in a batch with a search that goes on."""
    overrides = (*BALL, LIDARS, "referee.stop.time_limit_s=60", "agents[0].vehicle.search_height_m=1")
    outcomes = assert_equal_flights("warehouse_racks", overrides, [1, 4], hold_s=1.0)
    assert outcomes == ["collision"] * 2


@pytest.mark.slow
def test_a_search_is_run_again_alone_from_the_scenario_that_it_shows():
    task = LearningTask(scenario="tiny_room", overrides=(*PUFFS, LIMIT))
    batch = BatchSearchEnv([task.loaded(1), task.loaded(2)], 5, hold_s=0.5)
    batch.reset(seed=3)
    for _ in range(60):
        batch.step(np.zeros((5, 2), np.float32))
    observations, _ = batch.reset()
    for i in range(5):
        flight = SteppedRun(batch.loaded(i))
        vector = ObservationVector(flight.get_briefing("beetle"))
        assert np.array_equal(vector.of(flight.seen_by("beetle")), observations[i])
        flight.close()
    batch.close()


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        (
            "agents[0].vehicle.model=iris",
            "agents[0].vehicle.model: expected holonomic in a batch, or flying first_order or rigid_body, was iris.",
        ),
        ("agents[0].vehicle.avoidance=2d", "agents[0].vehicle.avoidance: expected none in a batch, was 2d."),
        ("gas.model=farrell", "gas.model: expected gaussian_plume, meandering_plume, playback, or filament without "),
        (
            "agents[0].sensors[0]={model: camera, name: eye}",
            "model: expected a sensor of gas, wind or ranges in",
        ),
        (
            "gas={model: filament, turbulence: {kind: none}, wall_images: true, sources: [{position_m: [1.5, 2, 1]}]}",
            "gas.wall_images: expected false in a batch, was true.",
        ),
        (
            "gas={model: filament, sources: [{position_m: [1.5, 2, 1]}],"
            " turbulence: {kind: given, intensity_frac: 0.2, length_m: 0.5}}",
            "gas.turbulence.kind: expected none in a batch, was given.",
        ),
        ("referee.stop.on_collision=false", "referee.stop.on_collision: expected true in a batch, was false."),
    ],
)
def test_what_cannot_be_batched_is_reported_in_one_sentence(override, sentence):
    task = LearningTask(scenario="tiny_room", overrides=(*BALL, override))
    with pytest.raises(UsageError) as caught:
        BatchSearchEnv([task.loaded(1)], 2)
    assert sentence in str(caught.value)
    assert "Change it, or fly single environments of gslcosim/Search-v0." in str(caught.value)


def _opens_a_file(parameters, state, ppm, wind_m_s, velocity_m_s, stream, values):
    return open("somewhere")  # noqa: PTH123


@pytest.mark.parametrize(
    ("kernel", "sentence"),
    [
        (
            SensorKernel(advance=measure_pid, n_values=5),
            "expected at most 4 values of a reading in a batch, was 5",
        ),
        (SensorKernel(advance=_opens_a_file), "sensor pid: expected a scalar kernel that can be compiled, was "),
    ],
)
def test_a_kernel_that_batches_cannot_have_is_reported(kernel, sentence, monkeypatch):
    kind = replace(SENSOR_MODELS["pid"], kernel=lambda spec, gases, tick_s: kernel, for_gases=None)
    monkeypatch.setitem(SENSOR_MODELS, "pid", kind)
    task = LearningTask(scenario="tiny_room", overrides=(*BALL, "agents[0].sensors[0]={model: pid, name: nose}"))
    with pytest.raises(UsageError, match=sentence):
        BatchSearchEnv([task.loaded(1)], 2)


@pytest.mark.slow
def test_ten_thousand_searches_take_less_than_32_mb():
    batch = BatchSearchEnv([LearningTask(scenario="tiny_room", overrides=BALL).loaded(1)], 10_000)
    assert 10_000 * batch.bytes_per_env < 32_000_000
    batch.close()


@pytest.mark.slow
def test_cases_are_drawn_by_weights_at_every_reset_until_the_next():
    cases = [LearningTask(scenario="tiny_room", overrides=(*BALL, LIMIT)).loaded(seed) for seed in (1, 2, 3)]
    envs = BatchSearchEnv(cases, 40, hold_s=1.0)
    envs.reset(seed=5, options={"weights": [1, 0, 3]})
    flown = []
    for _ in range(20):
        _, _, terminated, truncated, infos = envs.step(np.zeros((40, 2), np.float32))
        if (ends := terminated | truncated).any():
            assert np.array_equal(infos["_case"], ends)
            flown.append(infos["case"][ends])
    counts = np.bincount(np.concatenate(flown), minlength=3)
    assert len(flown) > 1
    assert counts[1] == 0
    assert 1.5 < counts[2] / counts[0] < 6
    with pytest.raises(UsageError, match="or weights, was speeds"):
        envs.reset(options={"speeds": [1] * 40})
    envs.close()


@pytest.mark.slow
def test_it_is_a_vector_environment_whose_searches_begin_again_as_it_declares():
    case = LearningTask(scenario="tiny_room", overrides=(*BALL, LIMIT)).loaded(1)
    for mode, declared in (("next_step", AutoresetMode.NEXT_STEP), ("same_step", AutoresetMode.SAME_STEP)):
        envs = BatchSearchEnv([case], 3, autoreset_mode=mode, hold_s=1.0)
        assert isinstance(envs, VectorEnv)
        assert envs.metadata["autoreset_mode"] == declared
        first, _ = envs.reset(seed=5)
        again, _ = envs.reset(seed=5)
        assert np.array_equal(first, again)
        assert envs.observation_space.contains(first)
        truncated = np.zeros(3, np.bool_)
        while not truncated.any():
            seen, rewards, terminated, truncated, infos = envs.step(np.zeros((3, 2), np.float32))
            assert rewards.shape == terminated.shape == (3,)
        assert list(infos["outcome"]) == ["time_limit"] * 3
        if mode == "same_step":
            assert (infos["time_s"] < 8).all()
            assert all(final[8] == 1.0 for final in infos["final_obs"])
        else:
            assert (seen[:, 8] == 1.0).all()
            seen, rewards, terminated, truncated, infos = envs.step(np.zeros((3, 2), np.float32))
            assert not (rewards.any())
            assert not (truncated.any())
            assert (infos["time_s"] < 8).all()
        envs.close()
