"""`gslcosim compare`: bitwise comparison of two runs, with their first difference."""

import argparse

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import DIGEST, Command, add_runs_dir_option, find_in_run
from gslcosim.cli.terminal import add_json_option, write, write_json

EXAMPLES = """  gslcosim compare runs/first runs/second
  gslcosim compare warehouse_empty-seed7-20250101 warehouse_empty-seed7-20250102 --json"""
_KINSHIPS = {
    "a": "The first is a fork of the second at tick {tick}.",
    "b": "The second is a fork of the first at tick {tick}.",
    "both": "Both are forks of one run, the earlier at tick {tick}.",
}


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    for name in ("a", "b"):
        parser.add_argument(name, metavar=name.upper(), help="a run: its folder, its digest.json, or its id")
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.runtime.replay.compare import RunComparison

    files = [find_in_run(run, runs_dir=arguments.runs_dir, file_name=DIGEST) for run in (arguments.a, arguments.b)]
    compared = RunComparison.of(*files)
    a, b, divergence, kinship = compared.a, compared.b, compared.divergence, compared.kinship
    if arguments.json:
        write_json(
            {
                "equal": divergence is None,
                "digests": [a.hex, b.hex],
                "final_ticks": [a.final_tick, b.final_tick],
                "divergence": divergence and vars(divergence),
                "fork": kinship and vars(kinship),
                "changed_agents": list(compared.changed_agents),
            }
        )
    elif divergence is None:
        write(f"Equal: digest {a.hex}, final tick {a.final_tick}.")
    else:
        write(
            f"Different from tick {divergence.tick} on: participant {divergence.participant}, port {divergence.port}: "
            f"{divergence.text}."
        )
        for file, digest in zip(files, (a, b), strict=True):
            write(f"  {digest.hex}  final tick {digest.final_tick}  {file.parent}")
    if kinship is not None and not arguments.json:
        write(_KINSHIPS[kinship.fork].format(tick=kinship.tick))
        if compared.changed_agents:
            write(f"Briefed differently: {', '.join(compared.changed_agents)}.")
    return 0 if divergence is None else ExitCode.DIVERGENCE


COMMAND = Command(
    name="compare",
    summary="compare two runs: equal, or the first tick, participant and port that differ",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
