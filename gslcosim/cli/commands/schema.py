"""`gslcosim schema`: the contract between gslcosim and agents, for every language."""

import argparse
from pathlib import Path

from gslcosim.base.errors import build_path_error
from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import add_json_option, write, write_json

EXAMPLES = """  gslcosim schema export
  gslcosim schema export my_agent/contract
  gslcosim schema export --json"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=["export"], metavar="export", help="write the files of the contract")
    parser.add_argument(
        "directory", nargs="?", type=Path, default=Path("contract"), metavar="DIR", help="where to (default: contract)"
    )
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.contract.messages import CONTRACT_VERSION
    from gslcosim.contract.publish.export import write_contract
    from gslcosim.contract.schema import get_contract_hash

    try:
        paths = write_contract(arguments.directory)
    except OSError as error:
        place, expected = "schema export", "a folder that can be written"
        raise build_path_error(error, place, expected, path=arguments.directory) from error
    if arguments.json:
        files = [path.relative_to(arguments.directory).as_posix() for path in paths]
        folder = str(arguments.directory)
        write_json({"version": CONTRACT_VERSION, "hash": get_contract_hash(), "directory": folder, "files": files})
    else:
        write(f"Contract {CONTRACT_VERSION}, hash {get_contract_hash()}: {len(paths)} files in {arguments.directory}")
    return 0


COMMAND = Command(
    name="schema",
    summary="write the contract: JSON Schemas, AsyncAPI and golden vectors",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
