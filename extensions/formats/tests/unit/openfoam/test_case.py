"""What stands in a case: conditions of each kind of patch, models, times; and what is refused."""

import re

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, MovingWall, Open, Outlet, Schedule, SlipWall
from gslcosim_formats.openfoam import write_case

CELL_M = 0.5
FREE = np.ones((6, 5, 4), bool)
INLET = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 1), velocity_m_s=(1, 0, 0.25))
OUTLET = Outlet(min_m=(3, 1.5, 0.5), max_m=(3, 2.5, 2))


def entries_of(path, name):
    """Return the dictionary `name { ... }` of a file as a mapping; it holds no other dictionaries."""
    body = re.search(rf"\n\s*{name}\s*\{{(.*?)\}}", path.read_text(), re.DOTALL)[1]
    return dict(re.findall(r"(\S+) (.*?);", body))


def text_of(folder, name):
    return (folder / name).read_text()


@pytest.fixture
def write(tmp_path):
    def write(*patches, **options):
        return write_case(
            FREE, CELL_M, patches or (INLET, OUTLET), tmp_path / "case", **{"end_time_s": 5.0} | options
        ).folder

    return write


def test_each_kind_of_patch_has_its_conditions(write):
    slip = SlipWall(min_m=(0, 0, 2), max_m=(3, 2.5, 2))
    belt = MovingWall(min_m=(0, 0, 0), max_m=(1, 2.5, 0), velocity_m_s=(0, 2, 0))
    folder = write(INLET, OUTLET, slip, belt)
    velocity, pressure = folder / "0" / "U", folder / "0" / "p"
    assert entries_of(velocity, "inlet_0") == {"type": "fixedValue", "value": "uniform (1 0 0.25)"}
    assert entries_of(velocity, "movingwall_3") == {"type": "fixedValue", "value": "uniform (0 2 0)"}
    assert entries_of(velocity, "walls") == {"type": "fixedValue", "value": "uniform (0 0 0)"}
    assert entries_of(velocity, "slipwall_2") == {"type": "slip"}
    assert entries_of(pressure, "outlet_1") == {"type": "fixedValue", "value": "uniform 0"}
    assert entries_of(pressure, "inlet_0") == {"type": "zeroGradient"}
    assert entries_of(folder / "0" / "nut", "movingwall_3")["type"] == "nutkWallFunction"


def test_an_inlet_brings_the_turbulence_that_the_built_in_solver_has_there(write):
    folder = write()
    speed_m_s = np.sqrt(1 + 0.25**2)
    k = 1.5 * (0.05 * speed_m_s) ** 2
    epsilon = 0.09**0.75 * k**1.5 / (0.1 * 1.0)
    for name, expected in (("k", k), ("epsilon", epsilon)):
        value = entries_of(folder / "0" / name, "inlet_0")["value"]
        assert float(value.removeprefix("uniform ")) == pytest.approx(expected)


def test_a_profile_is_written_face_by_face(write):
    profile_m_s = np.zeros((2, 2, 3))
    profile_m_s[..., 0] = [[1, 2], [3, 4]]  # y, z
    folder = write(Inlet(min_m=(0, 0, 0), max_m=(0, 1, 1), velocity_m_s=profile_m_s), OUTLET)
    value = entries_of(folder / "0" / "U", "inlet_0")["value"]
    assert value == "nonuniform List<vector> 4((1 0 0) (2 0 0) (3 0 0) (4 0 0))"


@pytest.mark.parametrize(
    ("turbulence", "fields"),
    [
        ("k_epsilon", {"U", "p", "k", "epsilon", "nut"}),
        ("rng_k_epsilon", {"U", "p", "k", "epsilon", "nut"}),
        ("smagorinsky", {"U", "p", "nut"}),
        ("laminar", {"U", "p"}),
    ],
)
def test_a_model_has_the_fields_it_needs(write, turbulence, fields):
    folder = write(turbulence=turbulence)
    assert {path.name for path in (folder / "0").iterdir()} == fields


def test_the_mean_is_taken_from_the_time_asked_for(write):
    folder = write(end_time_s=8.0, average_from_s=6.5)
    assert entries_of(folder / "system" / "controlDict", "mean")["timeStart"] == "6.5"


def test_the_mesh_is_cut_across_its_longest_side(write):
    assert "n (3 1 1);" in text_of(write(n_ranks=3), "system/decomposeParDict")


@pytest.mark.parametrize(
    ("patch", "message"),
    [
        (Open(min_m=(0, 0, 2), max_m=(3, 2.5, 2)), "expected one of Inlet, Outlet, MovingWall, SlipWall.*was Open"),
        (
            Inlet(
                min_m=(0, 1.5, 0),
                max_m=(0, 2, 1),
                velocity_m_s=(1, 0, 0),
                factor=Schedule(times_s=(0, 1), values=(0, 1)),
            ),
            "does not change in time.*Use the built-in solver",
        ),
    ],
)
def test_what_openfoam_does_not_know_of_is_refused(write, patch, message):
    with pytest.raises(FlowError, match=message):
        write(INLET, OUTLET, patch)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_ranks": 0}, "n_ranks: expected at least 1 process, was 0"),
        ({"courant": 0.0}, "courant: expected above 0"),
        ({"turbulence": "k_omega"}, "expected one of k_epsilon, rng_k_epsilon, smagorinsky, laminar, was 'k_omega'"),
        ({"end_time_s": -1.0}, "end_time_s: expected a time above 0 s"),
        ({"average_from_s": 5.0}, "average_from_s: expected from 0 to below end_time_s"),
    ],
)
def test_options_that_make_no_sense_are_refused(write, options, message):
    with pytest.raises(FlowError, match=message):
        write(**options)


def test_a_folder_with_something_in_it_is_left_alone(write, tmp_path):
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "thesis.txt").write_text("years of work")
    with pytest.raises(FlowError, match="Choose a new or empty folder"):
        write()
    assert [path.name for path in (tmp_path / "case").iterdir()] == ["thesis.txt"]
