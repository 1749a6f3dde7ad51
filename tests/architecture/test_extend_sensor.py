"""docs/extend/sensor.md: every step is carried out, on a copy."""

import json
import re
import shlex
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "extend" / "sensor.md").read_text()


@pytest.fixture(scope="module")
def package(lay_out_package, tmp_path_factory):
    return lay_out_package(PAGE, tmp_path_factory.mktemp("clicks"))


@pytest.mark.slow
def test_the_sensor_is_listed_and_runs(package, gslcosim_with, tmp_path):
    listed = json.loads(gslcosim_with(package, ["list", "sensors", "--json"], tmp_path).stdout)["sensors"]
    assert "clicks" in [row["name"] for row in listed]
    (command,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    program, *words = shlex.split(command)
    assert program == "gslcosim"
    short = ["--set", "referee.stop.time_limit_s=20", "--set", "recording.enabled=false", "--in-process"]
    done = gslcosim_with(package, [*words, *short], tmp_path)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    (resolved,) = tmp_path.glob("runs/*/scenario.yaml")
    assert "above_ppm: 0.5" in resolved.read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("block", "expected"),
    [
        ("{model: clicks, name: nose, above_ppm: 0}", "above_ppm: expected a number greater than 0"),
        ("{model: clicks, name: nose, below_ppm: 1}", "below_ppm: expected one of the keys"),
        ("{model: clikcs, name: nose}", "Did you mean clicks?"),
    ],
)
def test_what_it_does_not_have_is_refused_with_its_place(package, gslcosim_with, tmp_path, block, expected):
    done = gslcosim_with(package, ["validate", "tiny_room", "--set", f"agents[0].sensors=[{block}]"], tmp_path)
    assert done.returncode == 2
    assert "agents[0].sensors[0]" in done.stdout + done.stderr
    assert expected in done.stdout + done.stderr
