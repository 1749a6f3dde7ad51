"""docs/extend/sensor.md: every step is carried out, on a copy."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import BUILD_S

PAGE = (Path(__file__).parents[2] / "docs" / "extend" / "sensor.md").read_text()


@pytest.fixture(scope="module")
def package(lay_out_package, tmp_path_factory):
    return lay_out_package(PAGE, tmp_path_factory.mktemp("clicks"))


@pytest.mark.slow
def test_the_sensor_is_listed_and_runs(package, gslcosim_with, tmp_path, find_words):
    listed = json.loads(gslcosim_with(package, ["list", "sensors", "--json"], tmp_path).stdout)["sensors"]
    assert "clicks" in [row["name"] for row in listed]
    words = find_words(PAGE)
    short = ["--set", "referee.stop.time_limit_s=20", "--set", "recording.enabled=false", "--in-process"]
    done = gslcosim_with(package, [*words, *short], tmp_path)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    (resolved,) = tmp_path.glob("runs/*/scenario.yaml")
    assert "above_ppm: 0.5" in resolved.read_text()


BATCH = """
import numpy as np
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.search_env import SearchEnv
from gslcosim_training.stepped_run import LearningTask

overrides = (
    "agents[0].vehicle.model=holonomic", "agents[0].vehicle.avoidance=none", "gas.model=gaussian_plume",
    "agents[0].sensors=[{model: clicks, name: nose, above_ppm: 0.01, delay_s: 0.2}, {model: anemometer, name: wind}]",
)
task = LearningTask(scenario="tiny_room", overrides=overrides)
batch = BatchSearchEnv([task.loaded(1)], 3, action="velocity", hold_s=0.5)
alone = SearchEnv("tiny_room", overrides=overrides, action="velocity", hold_s=0.5)
i = batch.observation_names.index("nose.hits")
shown = set()
observed, _ = batch.reset(seed=1, options={"cases": np.zeros(3, int), "seeds": np.ones(3, int)})
single, _ = alone.reset(seed=1)
for _ in range(25):
    assert all(np.array_equal(one, single) for one in observed)
    shown.add(float(single[i]))
    action = np.array([-0.8, -0.1], np.float32)
    observed, _, ends, cuts, _ = batch.step(np.stack([action] * 3))
    single, _, end, cut, _ = alone.step(action)
    if end or cut:
        break
print(len(shown))
"""


@pytest.mark.slow
def test_it_flies_in_a_batch_as_alone(package):
    paths = os.pathsep.join([str(package), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-c", BATCH], env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True,
        check=False, timeout=BUILD_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 2, "it has met gas, and has lost it or counted on"
