"""`gslcosim schema`: the contract between gslcosim and agents, for all languages, and schemas of files for editors."""

import argparse
import shutil
from pathlib import Path

from gslcosim.base.errors import build_path_error
from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import add_json_option, write, write_json

EXAMPLES = """  gslcosim schema export
  gslcosim schema export my_agent/contract
  gslcosim schema export --json
  gslcosim schema files"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "action",
        choices=["export", "files"],
        metavar="export|files",
        help=(
            "write the files of the contract, or the JSON Schemas with which editors complete and "
            "check scenarios, suites, method cards, families and train files"
        ),
    )
    parser.add_argument(
        "directory", nargs="?", type=Path, metavar="DIR", help="output folder (default: contract; for files: schemas)"
    )
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    is_contract = arguments.action == "export"
    folder = arguments.directory or Path("contract" if is_contract else "schemas")
    try:
        return (_export_contract if is_contract else _export_file_schemas)(folder, is_json=arguments.json)
    except OSError as error:
        place, expected = f"schema {arguments.action}", "a folder that can be written"
        raise build_path_error(error, place, expected, path=folder) from error


def _export_contract(folder: Path, *, is_json: bool) -> int:
    from gslcosim.contract.version import CONTRACT_HASH, CONTRACT_VERSION

    files = _copy_contract(folder)
    if is_json:
        written = {"directory": str(folder), "files": files}
        write_json({"version": CONTRACT_VERSION, "hash": CONTRACT_HASH, **written})
    else:
        write(f"Contract {CONTRACT_VERSION}, hash {CONTRACT_HASH}: {len(files)} files in {folder}")
    return 0


def _export_file_schemas(folder: Path, *, is_json: bool) -> int:
    from gslcosim.base.bundled import bundled_schemas
    from gslcosim.base.yaml_core import EDITOR_HEADER

    folder.mkdir(parents=True, exist_ok=True)
    files = [path.name for path in bundled_schemas().values()]
    for path in bundled_schemas().values():
        shutil.copyfile(path, folder / path.name)
    if is_json:
        write_json({"directory": str(folder), "files": files})
    else:
        write(f"{len(files)} schemas in {folder}. The first line of a scenario beside that folder:")
        write(f"{EDITOR_HEADER}$schema={folder.name}/{files[0]}")
    return 0


# Return the names of the files, the index files first, then the files of each message.
def _copy_contract(folder: Path) -> list[str]:
    from gslcosim.base.bundled import bundled_contract
    from gslcosim_conformance.message_schemas import list_published_types

    files = ["README.md", "contract.json", "asyncapi.yaml", "participation.yaml"]
    files += [f"{part}/{item.__name__}.json" for item in list_published_types() for part in ("schemas", "vectors")]
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(bundled_contract() / name, folder / name)
    return files


COMMAND = Command(
    name="schema",
    summary=("write the contract (JSON Schemas, AsyncAPI, golden vectors), or schemas of files for editors"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
