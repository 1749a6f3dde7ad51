"""`gslcosim validate`: all problems of a scenario, before anything starts."""

import argparse

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import Command
from gslcosim.cli.scenario_arguments import add_scenario_arguments, load_checked
from gslcosim.cli.terminal import add_json_option, write, write_json

EXAMPLES = """  gslcosim validate my_scenario.yaml
  gslcosim validate warehouse_empty --set wind.cell_m=0.1
  gslcosim validate my_scenario.yaml --resolved > complete.yaml"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument(
        "--resolved", action="store_true", help="print the scenario with all defaults and changes filled in"
    )
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.scenario import dump_resolved
    from gslcosim.scenario.problems import InvalidScenarioError
    from gslcosim.scenario.serialization import plain_values

    try:
        loaded = load_checked(arguments)
    except InvalidScenarioError as error:
        if not arguments.json:
            raise
        write_json({"valid": False, "problems": [located.as_fields() for located in error.problems]})
        return ExitCode.USAGE
    if arguments.json:
        write_json({"valid": True, "problems": [], "scenario": plain_values(loaded.scenario)})
    elif arguments.resolved:
        write(dump_resolved(loaded.scenario).rstrip("\n"))
    else:
        agents = ", ".join(agent.name for agent in loaded.scenario.agents)
        write(f"{arguments.scenario}: valid. Scenario {loaded.name}, seed {loaded.scenario.seed}, agents: {agents}.")
    return 0


COMMAND = Command(
    name="validate",
    summary="check a scenario and tell all its problems at once",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
