"""docs/extend/service.md: every step is carried out, on a copy."""

import json
import re
import shlex
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "extend" / "service.md").read_text()
FAILED_THE_TASK = 1


@pytest.fixture(scope="module")
def package(lay_out_package, tmp_path_factory):
    return lay_out_package(PAGE, tmp_path_factory.mktemp("alarm"))


def flown(words, package, gslcosim_with, folder):
    folder.mkdir()
    short = ["--set", "referee.stop.time_limit_s=3", "--set", "recording.enabled=false"]
    done = gslcosim_with(package, [*words, *short], folder)
    assert done.returncode == FAILED_THE_TASK, done.stdout + done.stderr
    (digest,) = folder.glob("runs/*/digest.json")
    return json.loads(digest.read_text())


@pytest.mark.slow
@pytest.mark.tour
@pytest.mark.end_to_end
@pytest.mark.timeout(300)
def test_a_service_of_a_package_flies_in_one_process_and_in_many_with_one_digest(package, gslcosim_with, tmp_path):
    (command,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    program, *words = shlex.split(command)
    assert program == "gslcosim"
    alone = flown([*words, "--in-process"], package, gslcosim_with, tmp_path / "alone")
    many = flown(words, package, gslcosim_with, tmp_path / "many")
    assert alone["ports"]["alarm/state"]["participant"] == "alarm"
    assert len(alone["ports"]["alarm/state"]["ticks"]) == 31
    assert alone["digest"] == many["digest"]
    assert list((tmp_path / "many").glob("runs/*/logs/alarm.log"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("block", "told"),
    [
        ("{name: alarm, above_ppm: 0}",
         "services[0].above_ppm: expected a number greater than 0 in ppm, was 0."),
        ("{name: alarm, below_ppm: 1}",
         "services[0].below_ppm: expected one of the keys name, above_ppm, was an unknown key."),
        ("{name: alrm}",
         "services[0].name: expected the name of a service that an installed package offers (alarm), was 'alrm'."),
    ],
)  # fmt: skip
def test_what_no_package_offers_is_refused(package, gslcosim_with, tmp_path, block, told):
    done = gslcosim_with(package, ["validate", "tiny_room", "--set", f"services=[{block}]"], tmp_path)
    assert done.returncode == 2
    assert told in done.stdout + done.stderr
