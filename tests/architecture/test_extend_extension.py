"""docs/extend/extension.md: every step is carried out, in a folder outside the checkout."""

import json
import re
import shlex
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "extend" / "extension.md").read_text()
# The start's value; `sandbox: none`, as the package lies in a folder of the test in place of an installation.
SHORT = ["--set", "referee.stop.time_limit_s=5", "--set", "recording.enabled=false", "--set", "agents[0].sandbox=none"]


@pytest.fixture(scope="module")
def package(lay_out_package, tmp_path_factory):
    return lay_out_package(PAGE, tmp_path_factory.mktemp("dosimeter"))


@pytest.fixture(scope="module")
def commands():
    """Command lines of the page by their first word, without `pip install`."""
    (block,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    lines = [shlex.split(line) for line in block.splitlines()]
    assert lines[0] == ["pip", "install", "."]
    return {words[1]: words[1:] for words in lines[1:]}


@pytest.mark.slow
def test_the_command_is_in_the_help_and_runs(package, gslcosim_with, commands, tmp_path):
    assert "sources" in gslcosim_with(package, ["--help"], tmp_path).stdout
    done = gslcosim_with(package, commands["sources"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.match(r"source 0: ethanol, \d+ mm3/s of pure gas", done.stdout)


@pytest.mark.slow
def test_the_sensor_and_the_start_are_known(package, gslcosim_with, commands, tmp_path):
    listed = json.loads(gslcosim_with(package, ["list", "sensors", "--json"], tmp_path).stdout)["sensors"]
    assert "dosimeter" in [row["name"] for row in listed]
    done = gslcosim_with(package, commands["validate"], tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    wrong = [words.replace("{module: dosimeter_agent}", "{module: [1]}") for words in commands["validate"]]
    done = gslcosim_with(package, wrong, tmp_path)
    assert done.returncode == 2
    assert "agents[0].start.module" in done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.end_to_end
def test_a_run_has_the_sensor_and_the_started_agent(package, gslcosim_with, commands, tmp_path):
    done = gslcosim_with(package, [*commands["up"], *SHORT], tmp_path)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    (resolved,) = tmp_path.glob("runs/*/scenario.yaml")
    assert "module: dosimeter_agent" in resolved.read_text()
    (result,) = tmp_path.glob("runs/*/result.json")
    assert json.loads(result.read_text())["valid"]
