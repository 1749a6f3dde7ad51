"""Wind by whatever the scenario says: uniform, solved, kept as frames, read from files, brought by an import."""

import dataclasses
import json

import numpy as np
import pytest
from pydantic import ValidationError

from gslcosim import flow
from gslcosim.environment.generation.builder import generate_environment
from gslcosim.environment.generation.cache import recipe
from gslcosim.environment.generation.wind import build_patches
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import Cell, Grid
from gslcosim.environment.store import load_environment
from gslcosim.scenario.models.geometry import LayoutSpec
from gslcosim.scenario.models.scenario import EnvironmentSpec, WindSpec

ROOM = EnvironmentSpec(layout=LayoutSpec(size_m=(3.0, 2.0, 2.0)))


def wind(**fields):
    return WindSpec(cell_m=0.25, **fields)


@pytest.mark.slow
def test_frames_of_a_solve_follow_each_other(tmp_path):
    spec = wind(end_time_s=3.0, save_every_s=0.5, save_from_s=1.0, loops=False)
    generate_environment(ROOM, spec, tmp_path / "room")
    frames = load_environment(tmp_path / "room").wind
    assert (frames.velocity_m_s.shape[0], frames.period_s, frames.is_looping) == (5, 0.5, False)
    assert not (frames.velocity_m_s[0] == frames.velocity_m_s[-1]).all()


@pytest.mark.slow
def test_a_solve_keeps_its_turbulence_where_it_is_asked_to(tmp_path):
    spec = wind(end_time_s=3.0, keep_turbulence=True)
    generate_environment(ROOM, spec, tmp_path / "room")
    environment = load_environment(tmp_path / "room")
    k, epsilon = np.moveaxis(environment.wind.k_epsilon, -1, 0)
    air = environment.occupancy != Cell.SOLID
    assert (k[air] > 0).all()
    assert (epsilon[air] > 0).all()
    plain = generate_environment(ROOM, wind(end_time_s=3.0), tmp_path / "plain").environment
    assert plain.wind.k_epsilon is None
    assert (plain.wind.velocity_m_s == environment.wind.velocity_m_s).all()


def test_turbulence_is_kept_only_by_models_that_have_k_and_epsilon():
    with pytest.raises(ValueError, match="keep_turbulence"):
        wind(turbulence="laminar", keep_turbulence=True)


@pytest.mark.slow
def test_without_an_end_the_statistics_settle_and_the_folder_says_so(tmp_path):
    made = generate_environment(ROOM, wind(inlet_velocity_m_s=(0.5, 0.0, 0.0), max_time_s=60.0), tmp_path / "room")
    report = json.loads((tmp_path / "room" / "wind_report.json").read_text())
    assert report["settling"]["has_settled"]
    assert report["mass_balance_relative"] < 0.005
    assert any("settled" in notice for notice in made.notices)


def test_a_parabolic_inlet_has_the_mean_that_was_asked_for():
    spec = wind(inlet_profile="parabolic", inlet_velocity_m_s=(0.8, 0.0, 0.0))
    inlet = build_patches(build_layout(ROOM.layout, spec), spec)[0]
    profile = np.asarray(inlet.velocity_m_s)
    assert profile.mean(axis=(0, 1)) == pytest.approx([0.8, 0.0, 0.0])
    assert profile[0, 0, 0] < 0.8 < profile[profile.shape[0] // 2, profile.shape[1] // 2, 0]


def test_a_schedule_reaches_the_solver():
    spec = wind(inlet_schedule={"times_s": (0, 2), "shares": (0.0, 1.0), "repeats": True})
    inlet = build_patches(build_layout(ROOM.layout, spec), spec)[0]
    assert isinstance(inlet.factor, flow.Schedule)
    assert float(inlet.factor.at(1.0)) == 0.5
    assert float(inlet.factor.at(2.5)) == 0.25


def test_openings_are_given_to_solvers_from_the_grid_s_origin():
    room = build_layout(ROOM.layout, wind())
    moved = dataclasses.replace(
        room,
        grid=Grid(origin_m=(-1.0, 2.0, 0.5), cell_m=0.25, shape=room.grid.shape),
        openings=tuple(
            dataclasses.replace(
                opening,
                min_m=tuple(a + b for a, b in zip(opening.min_m, (-1.0, 2.0, 0.5), strict=True)),
                max_m=tuple(a + b for a, b in zip(opening.max_m, (-1.0, 2.0, 0.5), strict=True)),
            )
            for opening in room.openings
        ),
    )
    assert [(p.min_m, p.max_m) for p in build_patches(moved, wind())] == [
        (p.min_m, p.max_m) for p in build_patches(room, wind())
    ]


LEAK = {"position_m": (1, 1, 1), "flow_m3_s": 1e-4}


@pytest.mark.parametrize(
    ("buoyancy", "more", "reason"),
    [
        ({}, {}, "Field required"),
        ({"releases": [{"position_m": (1, 1, 1)}]}, {}, "Field required"),
        ({"kind": "heat", "releases": [LEAK]}, {}, "Extra inputs"),
        ({"releases": [LEAK]}, {"end_time_s": None, "solver": "uniform"}, "no buoyancy"),
    ],
)
def test_buoyancy_that_means_nothing_is_refused(buoyancy, more, reason):
    with pytest.raises(ValidationError, match=reason):
        wind(**{"end_time_s": 5, "buoyancy": buoyancy, **more})


def test_a_room_without_buoyancy_is_made_from_what_it_was():
    assert "buoyancy" not in recipe(ROOM, wind(end_time_s=5))["wind"]
