"""Keys that extensions add to `start`: one that is there already, and a start without a command line, are refused."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from gslcosim.base import plugins
from gslcosim.base.errors import UsageError
from gslcosim.base.extensions import Registration
from gslcosim.base.scenario_keys import AGENT_START, AgentStart
from gslcosim.runtime.agents.loader import build_start_command
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.models import base
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.scenario.models.sensors import make_sensor_spec


def start_named(name, build_command=lambda _value, _agent: []):
    return AgentStart(name=name, annotation=str | None, description="d", build_command=build_command)


def test_a_key_of_the_core_cannot_be_added(monkeypatch):
    monkeypatch.setattr(base, "list_scenario_keys", lambda _: (start_named("python"),))
    monkeypatch.setattr(base, "find_registering_packages", lambda _: "mine")
    with pytest.raises(
        UsageError, match=r"a new key in agents\[\]\.start, was 'python' of mine, which is there already"
    ):
        base.with_registered_keys(AGENT_START)(StartSpec)


@pytest.mark.parametrize(
    ("build_command", "found"), [(lambda *_: [], r"\[\]"), (lambda *_: {}["wire"], r"KeyError\('wire'\)")]
)
def test_a_start_without_a_command_line_is_refused(build_command, found, monkeypatch):
    agent = load_scenario("tiny_room").scenario.agents[0]
    start = agent.start.model_copy(update={"python": None})
    monkeypatch.setattr(StartSpec, "registered", start_named("wire", build_command))
    monkeypatch.setattr(AgentStart, "get", lambda *_: "value")
    with pytest.raises(UsageError, match=rf"start\.wire: expected a command line from {__name__}, was {found}"):
        build_start_command(agent.model_copy(update={"start": start}), Path())


def test_a_sensor_of_the_core_cannot_be_offered_again(monkeypatch):
    point = Registration(group="gslcosim.sensors", name="pid", value="mine:PID", distribution="mine")
    monkeypatch.setattr(plugins, "list_registered", lambda _: [point])
    with pytest.raises(ValidationError, match="one package that offers the sensor 'pid', was gslcosim and mine:PID"):
        make_sensor_spec(model="pid", name="nose")
