"""A plume that goes ahead of its readers is seen as one that does not, to the bit."""

import dataclasses

import numpy as np
import pytest
from built_gas import build_plume
from built_rooms import build_air

from gslcosim.base.errors import ModelError
from gslcosim_services.fields.filament.downwash import Jets
from gslcosim_services.fields.filament_field import MAX_PREFETCHED_FRAMES, PrefetchedPlume, round_to_single_precision

JETS = Jets(centre_world_m=np.zeros((0, 3)), motor_distance_m=np.zeros(0), outflow_m_s=np.zeros(0))


@pytest.fixture
def plume_of():
    """Build equal plumes in a breeze."""
    return lambda: build_plume(build_air(wind_m_s=((0.3, 0.1, 0.0),)), noise_std_m=0.02)


def seen(source):
    filaments = round_to_single_precision(source.filaments)
    arrays = (filaments.position_world_m, filaments.sigma_m, filaments.source_index)
    return source.step, source.time_s, *(array.tobytes() for array in arrays)


@pytest.mark.parametrize("steps_per_frame", [1, 3])
@pytest.mark.parametrize("seed", range(4))
def test_going_ahead_changes_nothing_that_is_seen(plume_of, seed, steps_per_frame):
    live, ahead = plume_of(), PrefetchedPlume(plume_of(), step_s=0.1, steps_per_frame=steps_per_frame)
    rng = np.random.default_rng(seed)
    for source in (live, ahead):
        source.reset(5)
        source.advance(7)
    for _ in range(60):
        for _ in range(rng.integers(0, 4)):
            before = seen(ahead)
            ahead.prefetch()
            assert seen(ahead) == before
        for source in (live, ahead):
            source.advance(steps_per_frame)
        assert seen(ahead) == seen(live)


def test_only_so_much_is_kept(plume_of):
    ahead = PrefetchedPlume(plume_of(), step_s=0.1, steps_per_frame=1)
    assert [ahead.prefetch() for _ in range(MAX_PREFETCHED_FRAMES + 2)] == [True] * MAX_PREFETCHED_FRAMES + [False] * 2
    ahead.advance()
    assert ahead.prefetch()


def test_filaments_are_added_to_a_plume_that_is_not_ahead(plume_of):
    ahead = PrefetchedPlume(plume_of(), step_s=0.1, steps_per_frame=1)
    n = len(ahead.filaments.sigma_m)
    ahead.add_filaments(np.full((3, 3), 1.0))
    assert len(ahead.filaments.sigma_m) == n + 3
    ahead.prefetch()
    with pytest.raises(ModelError, match="no frame ahead of filaments"):
        ahead.add_filaments(np.full((1, 3), 1.0))


def test_a_reset_forgets_what_was_ahead(plume_of):
    live, ahead = plume_of(), PrefetchedPlume(plume_of(), step_s=0.1, steps_per_frame=1)
    ahead.prefetch()
    for source in (live, ahead):
        source.reset(9)
        source.advance(2)
    assert seen(ahead) == seen(live)


def test_an_error_is_raised_at_its_own_step():
    room = build_air(wind_m_s=((0.1, 0.0, 0.0), (0.1, 0.0, 0.0)))
    live, ahead = build_plume(room), PrefetchedPlume(build_plume(room), step_s=0.1, steps_per_frame=1)
    room.wind.velocity_m_s[1] = np.nan
    for source in (live, ahead):
        source.reset(5)
    steps_until_it_fails = [_steps_until_it_fails(source) for source in (live, ahead)]
    assert steps_until_it_fails[0] == steps_until_it_fails[1] > 3


def _steps_until_it_fails(source):
    n_steps = 0

    def go_on():
        nonlocal n_steps
        for _ in range(100):
            while isinstance(source, PrefetchedPlume) and source.prefetch():
                pass
            source.advance()
            n_steps += 1

    with pytest.raises(ModelError, match="not finite"):
        go_on()
    return n_steps


def test_what_comes_too_late_is_refused(plume_of):
    ahead = PrefetchedPlume(plume_of(), step_s=0.1, steps_per_frame=2)
    ahead.blow(JETS)
    ahead.prefetch()
    with pytest.raises(ModelError, match="expected no frame ahead"):
        ahead.blow(JETS)
    with pytest.raises(ModelError, match="expected to advance by 2 steps, was 1"):
        ahead.advance(1)


def test_a_frame_is_a_copy(plume_of):
    ahead = PrefetchedPlume(plume_of(), step_s=0.1, steps_per_frame=1)
    ahead.advance(20)
    ahead.prefetch()
    frame = ahead.filaments
    kept = dataclasses.replace(frame, position_world_m=frame.position_world_m.copy())
    while ahead.prefetch():
        pass
    assert np.array_equal(frame.position_world_m, kept.position_world_m)
