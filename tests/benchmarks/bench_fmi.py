"""Steps per second of FMUs over their processes, beside a program in C behind the gateway, in turns.

A fan in C of FMI 2 and 3, and the air conditioner of the participants' page. All get the same inputs.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "shared"))

from fan_units import build_fan

from gslcosim.contract.messages import FieldSamples, GasAmount, MountSample
from gslcosim.contract.participant import Core, Episode
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import build_core
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import load_scenario
from gslcosim_conformance.scaffold import PARTICIPANT_TEMPLATES

GAS = "samples[sensor=nose].gases[gas=ethanol].mixing_ratio_ppm"
IN_TURNS = 100


def build_cores(folder: Path, sandbox: str) -> dict[str, Core]:
    """Return the cores of one run, by what they stand for."""
    for version in (2, 3):
        build_fan(folder, version, name=f"fan_{version}.fmu")
    shutil.copy(PARTICIPANT_TEMPLATES / "air_conditioner.c", folder)
    compiling = ["cc", "-O2", "-std=c11", "-ffp-contract=off", "-o", "air_conditioner", "air_conditioner.c", "-lm"]
    subprocess.run(compiling, cwd=folder, check=True)
    units = [
        {
            "name": f"fan_{version}",
            "start": {"fmu": f"{folder}/fan_{version}.fmu"},
            "reads": [{"port": "truth/samples", "inputs": {"gas_ppm": GAS}}],
            "writes": ["state"],
            "outputs": {"state": {"share": "share", "is_in_gas": "is_in_gas"}},
        }
        for version in (3, 2)
    ]
    program = {
        "name": "air_conditioner",
        "start": {"command": [f"{folder}/air_conditioner"]},
        "reads": [{"port": "truth/samples"}],
        "writes": ["ventilation", "state"],
    }
    blocks = [{**block, "sandbox": sandbox} for block in (*units, program)]
    loaded = load_scenario("tiny_room", overrides=[f"participants={json.dumps(blocks)}"])
    environment_dir = prepare_environment(loaded.scenario, scenario_dir=loaded.directory)
    setup = RunSetup(
        run_dir=RunDir.create(folder / "runs", name="run", seed=1),
        scenario=loaded.scenario,
        environment_dir=environment_dir,
        environment=load_environment(environment_dir),
        directory=folder,
    )
    names = {"FMU of FMI 3": "fan_3", "FMU of FMI 2": "fan_2", "program in C": "air_conditioner"}
    return {what: build_core(name, setup) for what, name in names.items()}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=5000, metavar="N", help="steps of each (default: 5000)")
    parser.add_argument("--sandbox", default="auto", help="of all of them (default: the strongest)")
    arguments = parser.parse_args()
    gases = (GasAmount(gas="ethanol", mixing_ratio_ppm=1.5),)
    sample = MountSample(agent="beetle", sensor="nose", gases=gases, wind_world_m_s=(0.5, 0.0, 0.0))
    with tempfile.TemporaryDirectory() as scratch:
        cores = build_cores(Path(scratch), arguments.sandbox)
        took_s = dict.fromkeys(cores, 0.0)
        try:
            for core in cores.values():
                core.reset(Episode(seed=1))
            for first in range(0, arguments.n, IN_TURNS):
                for what, core in cores.items():
                    begun_s = time.perf_counter()
                    for tick in range(first, first + IN_TURNS):
                        core.step(tick, {"truth/samples": FieldSamples(tick=tick, samples=(sample,))})
                    took_s[what] += time.perf_counter() - begun_s
        finally:
            for core in cores.values():
                core.close()  # pyright: ignore[reportAttributeAccessIssue]
    for what, spent_s in took_s.items():
        sys.stdout.write(f"{what:14} {arguments.n / spent_s:7,.0f} steps/s over a process\n")


if __name__ == "__main__":
    main()
