"""Kernels of batches that count references give the same bits as those that do not."""

import os
import subprocess
import sys

import pytest
from deadlines import BUILD_S

from gslcosim_training.batch.reference_free_kernels import COUNTING_VARIABLE

FLOWN = """
import hashlib
import numpy as np
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.batch.reference_free_kernels import COUNTS_REFERENCES
from gslcosim_training.stepped_run import LearningTask

print(COUNTS_REFERENCES)
HALL = (
    "agents[0].mode=lockstep", "environment.layout.size_m=[12,10,4]", "referee.success.within_m=0.05",
    "gas.sources=[{position_m: [1.5, 1.5, 1], filaments_per_s: 10}]", "agents[0].vehicle.start_m=[6,5,0.2]",
    "agents[0].vehicle.search_height_m=1.5", "referee.stop.time_limit_s=200",
)
for plume, vehicle, flying in (
    ("gaussian_plume", "iris", "first_order"), ("meandering_plume", "holonomic", "point"),
    ("gaussian_plume", "iris", "rigid_body"),
):
    overrides = (*HALL, f"gas.model={plume}", f"agents[0].vehicle.model={vehicle}")
    case = LearningTask(scenario="tiny_room", overrides=overrides).loaded(3)
    more = {"flying": flying} if flying != "point" else {}
    batch = BatchSearchEnv([case], 4, action="velocity", n_threads=2, **more)
    digest, rng = hashlib.sha256(), np.random.default_rng(2)
    observed, _ = batch.reset(seed=1)
    for _ in range(150):
        digest.update(np.ascontiguousarray(observed).tobytes())
        observed, rewards, *_ = batch.step(rng.uniform(-1, 1, (4, 2)).astype(np.float32))
        digest.update(np.ascontiguousarray(rewards).tobytes())
    batch.close()
    print(digest.hexdigest())
"""


def flown(**variables):
    call = [sys.executable, "-c", FLOWN]
    # Kernels that count references must come from a folder of their own, not from the one that this process has set.
    chosen = {name: text for name, text in os.environ.items() if not name.startswith("NUMBA_CACHE")}
    done = subprocess.run(call, env=chosen | variables, capture_output=True, text=True, check=False, timeout=BUILD_S)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.slow
@pytest.mark.timeout(2 * BUILD_S)  # all kernels are compiled with references, for this test alone
def test_both_give_the_same_bits(tmp_path):
    without, *usual = flown()
    counting, *others = flown(**{COUNTING_VARIABLE: "1", "GSLCOSIM_CACHE": str(tmp_path)})
    assert (without, counting) == ("False", "True")
    assert usual == others
    assert len(set(usual)) == 3
