"""Methods in other languages are those of the Python agents of the same names: equal commands, equal digests."""

import subprocess
from functools import cache

import pytest
from deadlines import BUILD_S, PROCESS_S
from languages import ports
from real_runs import TINY_ROOM, fly_here

# The first test of a language builds it; on a new machine its packages are fetched, too.
pytestmark = [pytest.mark.slow, pytest.mark.end_to_end, pytest.mark.debian, pytest.mark.timeout(BUILD_S + PROCESS_S)]

# A larger room that is searched until the time is over, because success is asked for closer than legs can lead.
LONG = (
    "--set", "environment.layout.size_m=[12, 9, 4]",
    "--set", "agents[0].vehicle.start_m=[10, 6, 0.2]",
    "--set", "agents[0].vehicle.model=holonomic",
    "--set", "gas.warm_up_s=60",
    "--set", "referee.success={within_m: 0.001, of: source}",
    "--set", "referee.stop.time_limit_s=200",
)  # fmt: skip
NOSES = {"ohm": "tgs2600", "ppm": "pid"}
# What the port can do of what the Python method can, by method; see the README of its folder.
PARAMETERS = {
    "e_coli": ("{declares: false}", "{declares: false, eps: 0.0, step_m: 0.7, wall_margin_m: 0.3, hold_s: 0.2}"),
    "infotaxis": (
        "{declares: false}",
        "{declares: false, cell_m: 0.7, step_m: 1.2, n_headings: 5, may_stay: true, hold_s: 1.0, stop_s: 1.5, "
        "arrival: nothing, floor: 0.02, power: 0.6, wind_memory_s: 8, monitor_stops: 5}",
    ),
    "surge_cast": (
        "{declares: false}",
        "{declares: false, explore: random, lost_by: last_blank, growth: doubling, n_returns: 3, cast_m: 0.4, "
        "leash_legs: 6, leash_m: 1.5, step_m: 0.6, hold_s: 0.2, margin_m: 0.3}",
    ),
}

first_nose, *other_noses = NOSES
each_port = pytest.mark.parametrize(
    ("agent", "method"), [pytest.param(*port, id=f"{port[0].folder.name}-{port[1]}") for port in ports()]
)


def changes(nose, parameters):
    sensors = f"[{{model: {NOSES[nose]}, name: nose}}, {{model: anemometer, name: wind}}]"
    return (*LONG, "--set", f"agents[0].sensors={sensors}", "--set", f"agents[0].parameters={parameters}")


@pytest.fixture(scope="module")
def fly_reference(tmp_path_factory):
    """Fly the Python agent of a method, once for the ports in all languages."""

    @cache
    def fly(method, nose, n):
        arguments = (*changes(nose, PARAMETERS[method][n]), "--set", f"agents[0].start={{python: {method}}}")
        return fly_here(TINY_ROOM, tmp_path_factory.mktemp("python"), *arguments)

    return fly


@each_port
@pytest.mark.parametrize("nose", [first_nose, *(pytest.param(nose, marks=pytest.mark.soak) for nose in other_noses)])
@pytest.mark.parametrize("n", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_a_port_runs_like_python(tmp_path, fly_reference, agent, method, nose, n):
    agent.build()
    reference = fly_reference(method, nose, n)
    port = fly_here(TINY_ROOM, tmp_path, *changes(nose, PARAMETERS[method][n]), *agent.start_override(method))
    assert reference.result["agents"][0]["steps"] > 20
    assert port.result["faults"] == reference.result["faults"] == []
    assert port.result["digest"] == reference.result["digest"]


@each_port
def test_a_port_refuses_parameters_that_it_does_not_know(tmp_path, agent, method):
    agent.build()
    arguments = changes("ppm", "{wings: 2}")
    flown = fly_here(TINY_ROOM, tmp_path, *arguments, *agent.start_override(method))
    assert flown.result["end_reason"] == "agent_failed"
    assert "parameters.wings" in flown.result["faults"][0]["text"]


@each_port
def test_a_port_shows_which_methods_it_has(agent, method):
    agent.build()
    outcome = subprocess.run(agent.started_by("no_such"), input="", capture_output=True, text=True, check=False)
    assert outcome.returncode != 0
    assert method in outcome.stderr
