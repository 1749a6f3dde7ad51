"""`gslcosim train`: learn what a train file says, with checkpoints, curves and evaluation runs.

A package beside `gslcosim_training`, whose import registers with Gymnasium and so imports it: each start of `gslcosim`
would wait for that.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.base.bundled import bundled_train_files
from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command, CommandGroup, parse_positive_number, parse_whole_number
from gslcosim.cli.completion_words import YAML_FILES, find_named
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim_training.training_run import TrainingResult

EXAMPLES = """  gslcosim train open_halls_ctrnn
  gslcosim train open_halls_ctrnn --rounds 20 --out trained/first
  gslcosim train open_halls_ctrnn --out trained/first --resume
  gslcosim train my_training.yaml --record 5 --json"""
TRAINED_DIR = Path("trained")
_REPORTED_FIGURES = (
    "best_cost",
    "mean_cost",
    "reward",
    "mean_reward",
    "success",
    "validation_cost",
    "validation_success",
)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a train file, or the name of a bundled one")
    parser.add_argument("--out", type=Path, metavar="DIR", help="output folder (default: trained/NAME)")
    parser.add_argument("--resume", action="store_true", help="resume from the checkpoint in that folder")
    parser.add_argument(
        "--rounds",
        type=parse_positive_number,
        metavar="N",
        help="at most N rounds now; continue with --resume (default: all)",
    )
    parser.add_argument(
        "--record", type=parse_whole_number, default=2, metavar="N",
        help=("record runs of the best policy in the first N validation cases, below DIR/runs " "(default: 2)"),
    )  # fmt: skip
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_search.learned.policy_agent import POLICY_FILE
    from gslcosim_training.train_file import load_train_file
    from gslcosim_training.training_run import Training, build_entry, record_runs

    file = load_train_file(arguments.file, is_flown=True)
    name = file.spec.name
    folder = arguments.out or TRAINED_DIR / name
    with ProgressLine(f"training {name}", is_quiet=arguments.json) as line:
        watch = _Watch(line)
        training = Training(
            file, folder, is_resumed=arguments.resume, tell=watch.tell, show=watch.show,
            command=f"gslcosim train {arguments.file}",
        )  # fmt: skip
        try:
            trained = training.train(rounds=arguments.rounds)
        except KeyboardInterrupt:
            line.end()
            write_note(f"Interrupted. Resume with gslcosim train {arguments.file} --out {folder} --resume.")
            return ExitCode.INTERRUPTED
    _draw(trained)
    runs: list[str] = []
    if trained.best is not None and arguments.record:
        cases = training.validation_cases[: arguments.record]
        flown = record_runs(file.family.name, cases, build_entry(trained.best, folder / POLICY_FILE), folder / "runs")
        runs = [str(result.run_dir) for result in flown]
    fields = _fields(trained, runs)
    if arguments.json:
        write_json(fields)
    else:
        write(_text(trained, fields, arguments.file))
    return 0


class _Watch:
    """Shows how a training goes: a line for what is under way, with the figures of the last round."""

    def __init__(self, line: ProgressLine) -> None:
        self._line = line
        self._phase = ""

    def tell(self, what: str, done: int, total: int) -> None:
        """Show how far something is."""
        if what != self._phase:
            self._line.end()
            self._phase = what
        self._line.count(done, total, phase=what)

    def show(self, figures: Mapping[str, float], last: int) -> None:
        """Show how far the rounds are, and now and then what they come to."""
        done = int(figures["round"])
        self.tell("rounds", done, last)
        if "validation_cost" in figures or done == last:
            values = ", ".join(f"{name} {figures[name]:.3f}" for name in _REPORTED_FIGURES if name in figures)
            self._line.end()
            self._line.note(f"round {done} of {last}: {values}")


def _draw(trained: "TrainingResult") -> None:
    from gslcosim_training.training_run import draw_curves

    try:
        draw_curves(trained.curves, trained.folder)
    except UsageError as error:
        write_note(f"No figure of the curves: {error}")


def _fields(trained: "TrainingResult", runs: list[str]) -> dict[str, Any]:
    return {
        "name": trained.name,
        "folder": str(trained.folder),
        "is_over": trained.is_over,
        "rounds": len(trained.curves),
        "best_round": trained.best_round,
        "figures": trained.curves[-1],
        "training_time_s": round(trained.took_s, 1),
        "runs": runs,
    }


def _text(trained: "TrainingResult", fields: dict[str, Any], file: str) -> str:
    validated = [each for each in trained.curves if "validation_cost" in each]
    lines = [f"{trained.name}: {fields['rounds']} rounds in {trained.took_s:.0f} s."]
    if validated:
        best = min(validated, key=lambda each: each["validation_cost"])
        lines.append(
            f"Best in validation: round {trained.best_round}, cost {best['validation_cost']:.3f}, success "
            f"{100 * best['validation_success']:.0f} %."
        )
    if not trained.is_over:
        lines.append(
            f"The training is not complete. Continue with gslcosim train {file} --out {trained.folder} --resume."
        )
    if fields["runs"]:
        lines.append(f"Look at its flights: gslcosim view {fields['runs'][0]}")
    return "\n".join([*lines, f"Everything is in {trained.folder}."])


COMMAND = Command(
    name="train",
    is_computing=True,
    summary=("train a search method on a family of cases, with checkpoints, curves and recorded runs"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={"FILE": [find_named(bundled_train_files), YAML_FILES]},
    run=_run,
)
GROUPS = (CommandGroup(title="compare methods", commands=(COMMAND,)),)
