"""Edited wind: the same to the bit, as free of divergence as a full solve, nearer to it than the wind before."""

import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.generation.wind import no_progress, solve_wind_of_scenario
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.model import Cell
from gslcosim.environment.variants import fill_still_air
from gslcosim.flow.solve import AIR_NU_M2_S, SolverNumerics
from gslcosim.scenario.models.scenario import EnvironmentSpec
from gslcosim_formats import edited_wind
from gslcosim_formats.edited_wind import (
    EditedWindSpec,
    SettledFlow,
    adapt_flow,
    build_room_domain,
    prepare_edits,
    settle_flow,
)

CRATE = {"name": "crate", "min_m": [2, 1, 0], "max_m": [3, 2, 1]}
ROOM = {"kind": "warehouse_empty", "size_m": [6, 4, 2.5]}
BLOCK = EditedWindSpec(cell_m=0.25, settle_s=10.0, edit_s=2.0, before={"obstacles": []})
NUMERICS = SolverNumerics(turbulence="k_epsilon", nu_m2_s=AIR_NU_M2_S, courant=0.9)
U0_M_S = 1.0


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path))
    return tmp_path


@pytest.fixture(params=[0, 15_000], ids=["corrected on larger cells", "steps alone"])
def least_cells(request, monkeypatch):
    monkeypatch.setattr(edited_wind, "LEAST_CELLS", request.param)


@pytest.fixture(scope="module")
def own():
    return settle_flow(domain_of(spec()), NUMERICS, settle_s=40.0)


def spec(*obstacles, doors=(), **layout):
    return EnvironmentSpec.model_validate({"layout": {**ROOM, "obstacles": obstacles, **layout}, "doors": doors})


def domain_of(environment):
    return build_room_domain(fill_still_air(build_geometry(environment, BLOCK)), BLOCK)


def solved(environment, block=BLOCK):
    room = fill_still_air(build_geometry(environment, block))
    return room, solve_wind_of_scenario(room, environment, block, scenario_dir=None, progress=no_progress)


def rms(a_m_s, b_m_s):
    return np.sqrt(np.mean(np.sum((a_m_s - b_m_s) ** 2, axis=-1))) / U0_M_S


@pytest.mark.usefixtures("least_cells")
def test_an_edited_wind_is_the_same_to_the_bit_with_and_without_a_cache(cache):
    _, first = solved(spec(CRATE))
    (state,) = cache.rglob("wind_state.npz")
    _, from_cache = solved(spec(CRATE))
    state.write_bytes(state.read_bytes()[:1000])
    _, after_damage = solved(spec(CRATE))
    for other in (from_cache, after_damage):
        np.testing.assert_array_equal(other.frames.velocity_m_s, first.frames.velocity_m_s)


@pytest.mark.usefixtures("least_cells")
@pytest.mark.parametrize(
    "environment",
    [
        spec(CRATE),
        spec(doors=[{"name": "screen", "min_m": [3, 0, 0], "max_m": [3.25, 3, 2.5]}]),
        spec(openings=[{"name": "fan", "kind": "inlet", "min_m": [3, 4, 1], "max_m": [4, 4, 2],
                        "velocity_m_s": [0, -0.5, 0]}]),
    ],
    ids=["box", "door", "fan"],
)  # fmt: skip
def test_an_edit_is_divergence_free_and_brings_the_wind_nearer_to_the_full_solve(own, environment):
    before, after = domain_of(spec()), domain_of(environment)
    full = adapt_flow(SettledFlow(own=settle_flow(after, NUMERICS, settle_s=30.0), coarse=None), after, NUMERICS,
                      edit_s=10.0)  # fmt: skip
    edited = adapt_flow(prepare_edits(own, before, NUMERICS, edit_s=4.0), after, NUMERICS, edit_s=4.0)
    unedited = adapt_flow(SettledFlow(own=own, coarse=None), before, NUMERICS, edit_s=1.0)
    assert edited.divergence_relative <= 2e-5 >= full.divergence_relative
    assert rms(edited.velocity_m_s, full.velocity_m_s) < 0.9 * rms(unedited.velocity_m_s, full.velocity_m_s)


def test_larger_cells_add_nothing_to_a_room_that_is_as_before(own, monkeypatch):
    monkeypatch.setattr(edited_wind, "LEAST_CELLS", 0)
    domain = domain_of(spec())
    settled = prepare_edits(own, domain, NUMERICS, edit_s=2.0)
    alone = adapt_flow(SettledFlow(own=settled.own, coarse=None), domain, NUMERICS, edit_s=1.0)
    assert settled.coarse is not None
    np.testing.assert_array_equal(adapt_flow(settled, domain, NUMERICS, edit_s=2.0).velocity_m_s, alone.velocity_m_s)


@pytest.mark.usefixtures("cache")
def test_air_behind_a_closed_door_is_still_and_solids_have_no_wind():
    walls = [
        {"name": "south", "min_m": [3, 0, 0], "max_m": [3.25, 1, 2.5]},
        {"name": "chamber", "min_m": [3, 1, 0], "max_m": [6, 1.25, 2.5]},
    ]
    gate = {"name": "gate", "min_m": [3, 0.25, 0], "max_m": [3.25, 0.75, 2]}
    walls[0]["max_m"] = [3.25, 0.25, 2.5]
    walls += [
        {"name": "north", "min_m": [3, 0.75, 0], "max_m": [3.25, 1, 2.5]},
        {"name": "lintel", "min_m": [3, 0.25, 2], "max_m": [3.25, 0.75, 2.5]},
    ]
    room, closed = solved(spec(*walls, doors=[gate]), BLOCK.model_copy(update={"before": {}}))
    _, opened = solved(spec(*walls), BLOCK.model_copy(update={"before": {}}))
    velocity_m_s = closed.frames.velocity_m_s[0]
    chamber = (slice(14, 24), slice(0, 4), slice(0, 10))
    assert not velocity_m_s[room.occupancy == Cell.SOLID].any()
    assert not velocity_m_s[chamber].any()
    assert opened.frames.velocity_m_s[0][chamber].any()


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize(
    ("before", "expected"),
    [
        ({"obstacle": []}, r"^wind\.before: expected keys of environment\.layout, was obstacle\. For example before:"),
        ({"size_m": [6, 4, 3]}, r"^wind\.before: expected a room on the same cells, was .* Leave size_m as it is\.$"),
    ],
)
def test_a_room_before_that_does_not_fit_is_refused(before, expected):
    with pytest.raises(EnvironmentDataError, match=expected):
        solved(spec(CRATE), BLOCK.model_copy(update={"before": before}))
