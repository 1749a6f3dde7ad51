"""What evolution gave a particle swarm: three robots with evolved parameters beside as many with those set by hand.

    python docs/studies/evolved_swarms.py --n 60

Every team meets the same cases of the split `test` of the family `open_halls`: the first robot starts where the case
says, the others a metre from it, with the family's sensors and a radio without losses. A team succeeds with its first
robot. `s_pso` has the parameters that evolution began at; `persistent_walk` smells nothing. Figures and intervals are
those of training_to_flight.py; differences are of pairs.
"""

import argparse
import sys

from training_to_flight import Searches, rates, searches_of, shown_differences

from gslcosim.scenario.models.scenario import StartSpec
from gslcosim_bench.cases.models import EntrySpec
from gslcosim_training.family import load_family
from gslcosim_training.trainers.evolution import compute_rows

FAMILY, PLACE, N_ROBOTS = "open_halls", "holonomic", 3
EVOLVED = ("evolved_pso", "evolved_pso_doped")
BESIDE = ("s_pso", "persistent_walk")
PAIRS = (*((name, other) for name in EVOLVED for other in BESIDE), ("evolved_pso_doped", "evolved_pso"))


def main() -> None:
    """Fly all, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=60, help="cases to fly")
    cases = load_family(FAMILY).cases("test", parser.parse_args().n)
    found: dict[str, Searches] = {}
    for name in (*EVOLVED, *BESIDE):
        rows = compute_rows(FAMILY, cases, EntrySpec(name=name, start=StartSpec(python=name), robots=N_ROBOTS))
        found[name] = searches_of([(row["success"], row["time_s"], row["time_limit_s"]) for row in rows])
        sys.stderr.write(f"{name}: {found[name].success.sum()} of {len(cases)}\n")
    sys.stdout.write(f"{rates({(FAMILY, PLACE, name): own for name, own in found.items()})}\n{differences(found)}")


def differences(found: dict[str, Searches]) -> str:
    """Return by how much teams differ in the same cases."""
    lines = ["| team | beside | more success, points | sooner, s |", "|---|---|---|---|"]
    for name, other in PAIRS:
        lines.append(f"| `{name}` | `{other}` | {shown_differences(found[name], found[other])} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
