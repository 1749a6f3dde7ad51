"""`gslcosim schema`: the contract between gslcosim and agents, for every language."""

import argparse
import shutil
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
    from gslcosim.contract.schema import get_contract_hash

    try:
        files = _copy_contract(arguments.directory)
    except OSError as error:
        place, expected = "schema export", "a folder that can be written"
        raise build_path_error(error, place, expected, path=arguments.directory) from error
    if arguments.json:
        folder = str(arguments.directory)
        write_json({"version": CONTRACT_VERSION, "hash": get_contract_hash(), "directory": folder, "files": files})
    else:
        write(f"Contract {CONTRACT_VERSION}, hash {get_contract_hash()}: {len(files)} files in {arguments.directory}")
    return 0


# The names of the files, those for programs to begin with first, then the files of each message.
def _copy_contract(folder: Path) -> list[str]:
    from gslcosim.base.bundled import bundled_contract
    from gslcosim.contract.schema import list_published_types

    files = ["README.md", "contract.json", "asyncapi.yaml", "participation.yaml"]
    files += [f"{part}/{item.__name__}.json" for item in list_published_types() for part in ("schemas", "vectors")]
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(bundled_contract() / name, folder / name)
    return files


COMMAND = Command(
    name="schema",
    summary="write the contract: JSON Schemas, AsyncAPI and golden vectors",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
