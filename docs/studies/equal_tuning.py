"""Tune methods with one budget each, and write a suite whose entries are every method as it is and tuned.

    python docs/studies/equal_tuning.py --jobs 1 infotaxis particle_filter
    gslcosim bench run results/equal_tuning/suite.yaml --seed 815

Budget, cases and the three numbers of each method are those of `equal_tuning.yaml`, named before any flight. Each
method is one call of `gslcosim bench tune`: 12 settings of 10 flights, the same cases for all methods, on training
seeds that no suite has; then 16 flights of the best and of the default on validation seeds. Without names all methods
are tuned. A method whose `tuning.json` is there is not tuned again, and an interrupted one resumes where it stopped.

`suite.yaml` includes the suite of the cases with two entries for each tuned method, `NAME` and `NAME_tuned`;
`tuning.csv` has what each gained. A method whose default was the best of its settings has no second entry.
"""

import argparse
import csv
import io
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

TABLE = Path(__file__).with_name("equal_tuning.yaml")
HEADS = (
    "method", "parameters", "flights", "training_default", "training_best", "validation_default", "validation_best",
    "difference", "low", "high", "p",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TuningPlan:
    """Budget of every method, and the ranges of each, as `gslcosim bench tune --range` reads them."""

    suite: str
    budget: int
    flights_per_setting: int
    seed: int
    methods: Mapping[str, Sequence[str]]


def main() -> None:
    """Tune the methods of the command line, one after the other, and write suite and table after each."""
    plan = TuningPlan(**yaml.safe_load(TABLE.read_text(encoding="utf-8")))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("methods", nargs="*", metavar="METHOD", help="a method of equal_tuning.yaml (default: all)")
    parser.add_argument("--results", type=Path, default=Path("results/equal_tuning"), metavar="DIR")
    parser.add_argument("--jobs", default="1", help="number of workers (default: 1)")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.methods if name not in plan.methods]
    if unknown:
        parser.error(f"METHOD: expected one of {', '.join(plan.methods)}, was {unknown[0]}. Add it to {TABLE.name}.")
    names = arguments.methods or list(plan.methods)
    for i, name in enumerate(names, start=1):
        sys.stdout.write(f"{i} of {len(names)}: {name}\n")
        sys.stdout.flush()
        folder = arguments.results / name
        if not (folder / "tuning.json").is_file():
            subprocess.run([*tune_command(plan, name, folder), "--jobs", arguments.jobs], check=True)
        write_tables(plan, arguments.results)


def tune_command(plan: TuningPlan, name: str, folder: Path) -> list[str]:
    """Return the command that tunes a method into a folder of its own."""
    command = [sys.executable, "-m", "gslcosim", "bench", "tune", plan.suite, "--entry", name, "--yes"]
    for each in plan.methods[name]:
        command += ["--range", each]
    command += ["--budget", str(plan.budget), "--flights-per-setting", str(plan.flights_per_setting)]
    return [*command, "--seed", str(plan.seed), "--results", str(folder)]


def write_tables(plan: TuningPlan, results: Path) -> None:
    """Write `suite.yaml` and `tuning.csv` of all methods that are tuned so far."""
    files = {name: results / name / "tuning.json" for name in plan.methods}
    tuned = {name: json.loads(file.read_text()) for name, file in files.items() if file.is_file()}
    suite = yaml.safe_dump(suite_of(plan, tuned), sort_keys=False, width=120)
    (results / "suite.yaml").write_text(suite, encoding="utf-8")
    (results / "tuning.csv").write_text(table_of(tuned), encoding="utf-8")


def suite_of(plan: TuningPlan, tuned: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return a suite of the plan's cases with an entry for each method, and one for its tuned parameters."""
    entries: list[dict[str, Any]] = []
    for name, fields in tuned.items():
        entries.append({"name": name, "start": {"python": name}})
        if fields["parameters"]:
            entries.append(
                {"name": f"{name}_tuned", "start": {"python": name}, "parameters": dict(fields["parameters"])}
            )
    return {
        "schema": "gslcosim/suite/1",
        "name": f"{plan.suite}_tuned",
        "title": f"{plan.suite}, every method as it is and tuned",
        "question": "What does the same budget of tuning gain each method?",
        "include": [plan.suite],
        "entries": entries,
        "anchors": [],
    }


def table_of(tuned: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a line for each method: parameters, flights, and scores of default and best with their difference."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADS)
    for name, fields in tuned.items():
        words = " ".join(f"{key}={value:g}" for key, value in fields["parameters"].items()) or "default"
        training = [_value(fields[which]["score"]) for which in ("default", "best")]
        writer.writerow([name, words, fields["budget"]["used"], *training, *_validation_cells(fields["validation"])])
    return text.getvalue()


def _validation_cells(validation: Mapping[str, Any] | None) -> list[str]:
    if validation is None:
        return [""] * 6
    scores = [_value(validation[which]["score"]) for which in ("default", "best")]
    gain = validation["difference"]
    return [*scores, *(f"{gain[key]:.3f}" for key in ("value", "low", "high")), f"{validation['p']:.3f}"]


def _value(estimate: Mapping[str, float]) -> str:
    return f"{estimate['value']:.3f}"


if __name__ == "__main__":
    main()
