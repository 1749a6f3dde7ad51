"""Gas on tape: equal to live gas to the bit, shared, and never stale."""

import numpy as np
import pytest
from built_gas import build_plume
from built_messages import build_body, build_poses

from gslcosim.base.errors import EnvironmentDataError, ModelError
from gslcosim.contract import codec, keys
from gslcosim.contract.participant import Episode
from gslcosim_formats.field_samplers import Instant, ScenarioFieldSampler, ViewOptions
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.tape import GasTape, TapeSchedule, record_tape, tape_hash

SOURCES = [{"position_m": (5.0, 5.0, 2.0)}, {"position_m": (5.0, 5.2, 2.0), "gas": "methane", "ppm": 50.0}]


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own for each test."""
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "tapes"


@pytest.fixture
def room(make_room):
    return make_room(wind_m_s=((0.3, 0.1, 0.0),))


@pytest.fixture
def scenario_of(make_scenario):
    """Build a short scenario whose gas is on tape or not."""

    def build(*, tape=True, sources=SOURCES[:1], time_limit_s=2.0, tick_ms=100, **gas):
        gas = {"sources": sources, "warm_up_s": 3.0, "tape": tape, **gas}
        return make_scenario(tick_ms=tick_ms, gas=gas, referee={"stop": {"time_limit_s": time_limit_s}})

    return build


def messages(scenario, room, *, seed=3, n_ticks=21):
    """Everything that the fields say in a run, as bytes."""
    core = FieldsCore(scenario, room)
    core.reset(Episode(seed=seed))
    body = build_body("agent_0", (6.0, 5.3, 2.0))
    said = []
    for tick in range(n_ticks):
        outbox = core.step(tick, {keys.BODIES: build_poses(tick, body)})
        said += [codec.encode(message) for _, message in sorted(outbox.items())]
    return said


@pytest.mark.parametrize(
    "gas",
    [
        {},
        {"sources": SOURCES},
        {"step_s": 0.05},
        {"step_s": 0.2, "warm_up_s": 4.0},
        {"warm_up_s": 0.0},
        {"turbulence": {}, "wall_images": True},
    ],
)
def test_gas_from_tape_is_live_gas_to_the_bit(scenario_of, room, cache, gas):
    live = messages(scenario_of(tape=False, **gas), room)
    assert not cache.exists()
    recorded = messages(scenario_of(**gas), room)
    played = messages(scenario_of(**gas), room)
    assert len([path for path in cache.iterdir() if not path.name.startswith(".")]) == 1
    assert recorded == live
    assert played == live


def test_each_seed_has_its_tape_and_runs_may_share_one(scenario_of, room, cache):
    for seed in (1, 2):
        assert messages(scenario_of(), room, seed=seed) == messages(scenario_of(tape=False), room, seed=seed)
    assert len(list(cache.iterdir())) == 2
    shared = [messages(scenario_of(seed=7), room, seed=seed) for seed in (1, 2)]
    assert shared[0] == shared[1]
    assert len(list(cache.iterdir())) == 3


def test_a_damaged_tape_is_recorded_again(scenario_of, room, cache, caplog):
    live = messages(scenario_of(), room)
    folder = next(iter(cache.iterdir()))
    for name in ("filaments.npy", "first.npy", "head.json"):
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: len(content) // 2])
        with pytest.raises(EnvironmentDataError, match="expected a whole one"):
            GasTape(folder)
        assert messages(scenario_of(), room) == live
        assert "damaged and is recorded anew" in caplog.text


def test_the_second_recorder_keeps_the_tape_of_the_first(scenario_of, room, cache):
    schedule = TapeSchedule(first_step=0, stride=1, n_frames=5)
    record_tape(build_plume(), schedule, cache / "tape")
    before = (cache / "tape" / "head.json").stat().st_ino
    record_tape(build_plume(), schedule, cache / "tape")
    assert (cache / "tape" / "head.json").stat().st_ino == before
    assert [path.name for path in cache.iterdir()] == ["tape"]


def test_a_plume_without_filaments_can_be_on_tape(cache):
    record_tape(build_plume(), TapeSchedule(first_step=0, stride=1, n_frames=1), cache / "tape")
    assert GasTape(cache / "tape").frame(0)[0].shape == (0, 4)


def test_only_instants_that_a_run_looks_at_are_on_tape():
    schedule = TapeSchedule(first_step=10, stride=2, n_frames=3)
    assert [schedule.frame_at(step) for step in (10, 12, 14, 16, 400)] == [0, 1, 2, 2, 2]
    for step in (9, 11, 0):
        with pytest.raises(ModelError, match="expected step 10 or a multiple of 2 after it"):
            schedule.frame_at(step)


def test_the_name_of_a_tape_changes_with_all_that_decides_the_gas(scenario_of, room, make_room):
    changed = [
        tape_hash(scenario_of(), room, 1),
        tape_hash(scenario_of(), room, 2),
        tape_hash(scenario_of(growth_m2_s=0.002), room, 1),
        tape_hash(scenario_of(time_limit_s=3.0), room, 1),
        tape_hash(scenario_of(tick_ms=200), room, 1),
        tape_hash(scenario_of(sources=SOURCES), room, 1),
    ]
    assert len(set(changed)) == len(changed)
    assert tape_hash(scenario_of(seed=5), room, 1) == changed[0]


def test_sampling_needs_no_tape(scenario_of, room, cache):
    ppm = ScenarioFieldSampler(room, scenario_of()).gas_ppm(
        np.array([(5.0, 5.0, 2.0)]), Instant(time_s=0.05), ViewOptions()
    )
    assert ppm[0] > 0.0
    assert not cache.exists()
