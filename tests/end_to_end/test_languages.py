"""The dung beetles of all languages are one and the same: equal commands, equal digests.

Every `agents/*/agent.yaml` is tested here; a language whose tools are missing is skipped and says so.
"""

import pytest
from deadlines import BUILD_S, PROCESS_S
from languages import SERIES, answers, golden_session, language_agents, of_every_language
from real_runs import TINY_ROOM, fly, fly_here

# The first test of a language builds it; on a new machine its packages are fetched, too.
pytestmark = [pytest.mark.debian, pytest.mark.timeout(BUILD_S + PROCESS_S)]

# A larger room that is searched until the time is over, because success is asked for closer than legs can lead:
# seeking, zigzags, walls and random headings.
LONG = (
    "--set", "environment.layout.size_m=[12, 9, 4]",
    "--set", "agents[0].vehicle.start_m=[10, 6, 0.2]",
    "--set", "gas.warm_up_s=60",
    "--set", "referee.success={within_m: 0.02, of: source}",
    "--set", "referee.stop.time_limit_s=200",
)  # fmt: skip
SCENARIOS = {"tiny_room": (), "long": LONG}


OVER_PIPES = [agent for agent in language_agents() if agent.door == "stdio"]
# The first agent of each transport and encoding: the run of many processes knows nothing of languages.
OF_EACH_TRANSPORT = {(agent.door, agent.format): agent for agent in reversed(language_agents())}.values()


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """The Python agent's runs in this framework's own process, by the scenario's name."""
    runs_dir = tmp_path_factory.mktemp("reference")
    flights = {name: fly_here(TINY_ROOM, runs_dir / name, *changes) for name, changes in SCENARIOS.items()}
    assert all(flight.result["valid"] for flight in flights.values())
    return flights


@of_every_language(OVER_PIPES)
@pytest.mark.parametrize(
    "series",
    [
        pytest.param(series, id=f"seed_{series['seed']}", marks=[pytest.mark.soak] if i else [])
        for i, series in enumerate(SERIES)
    ],
)
def test_a_language_answers_the_golden_series_to_the_bit(agent, series):
    """Walls, corners, refusals and random draws, all of which a run may happen not to visit."""
    agent.build()
    commands, exit_code = answers(agent.started_by(), agent.format, golden_session(series))
    assert exit_code == 0
    assert [command.tick for command in commands] == list(range(len(series["steps"])))
    assert {command.kind for command in commands} == {"waypoint"}
    assert [list(command.position_world_m) for command in commands] == [step["goal_m"] for step in series["steps"]]


@of_every_language(OVER_PIPES)
def test_a_language_exits_at_the_end_of_the_stream(agent):
    """A run that is gone says no `Ending`; an agent that waits for one would be left over."""
    agent.build()
    briefing, first, *_ = golden_session(SERIES[0])
    commands, exit_code = answers(agent.started_by(), agent.format, [briefing, first])
    assert len(commands) == 1
    assert exit_code == 0


@of_every_language(OVER_PIPES)
def test_a_language_refuses_a_contract_of_another_major_version(agent, capfd):
    """It says so and exits instead of flying by fields that may mean something else."""
    agent.build()
    briefing, first, *_ = golden_session(SERIES[0])
    other = briefing.model_copy(update={"contract_version": "2.0"})
    commands, exit_code = answers(agent.started_by(), agent.format, [other, first])
    assert commands == []
    assert exit_code != 0
    assert "2.0" in capfd.readouterr().err


@of_every_language(OF_EACH_TRANSPORT)
def test_a_language_runs_like_python_among_many_processes(tmp_path, reference, agent):
    """The same scenario and seed have the same digest, in whatever language the agent is written."""
    agent.build()
    assert_same_flight(fly(TINY_ROOM, tmp_path, *agent.start_override()), reference["tiny_room"])


@of_every_language()
def test_a_language_runs_far_like_python(tmp_path, reference, agent):
    """The same on a hundred legs; where the transport allows it with all but the agent in one process."""
    agent.build()
    flying = fly if agent.door == "zenoh" else fly_here
    assert_same_flight(flying(TINY_ROOM, tmp_path, *LONG, *agent.start_override()), reference["long"])


def assert_same_flight(flight, reference):
    assert flight.result["valid"], flight.errors
    assert flight.result["faults"] == []
    assert flight.result["digest"] == reference.result["digest"]


def test_the_long_run_visits_what_the_short_one_may_not(reference):
    """Otherwise the digests would agree too easily."""
    long, tiny = (reference[name].result for name in ("long", "tiny_room"))
    assert long["ticks"] > 10 * tiny["ticks"]
    assert long["agents"][0]["steps"] > 10 * tiny["agents"][0]["steps"]
