"""Parameter files: parameters learned for a method, as JSON with a card beside the program that uses them."""

import json
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from gslcosim.base.errors import MethodError
from gslcosim.base.files import replace_file
from gslcosim.base.untrusted_json import JsonObject, MalformedFileError, read_json
from gslcosim.contract.messages import ParameterValue

PARAMETERS_FILE = "parameters.json"
SCHEMA = "gslcosim/parameters/1"


def save_parameters(
    folder: Path, method: str, parameters: Mapping[str, ParameterValue], card: Mapping[str, Any]
) -> None:
    """Write parameters of a method into a folder, with a card that says how they came to be.

    Args:
        folder: Where; it is there.
        method: Name of the method.
        parameters: As scenarios take them.
        card: Plain values: data, seeds, budget, versions, the command.
    """
    whole = {"schema": SCHEMA, "method": method, "parameters": dict(parameters), **card}
    replace_file(folder, PARAMETERS_FILE, (json.dumps(whole, indent=1) + "\n").encode())


def load_parameters(path: Path) -> dict[str, ParameterValue]:
    """Return the parameters of a file.

    Raises:
        MethodError: it cannot be read, or is no such file.
    """
    try:
        whole = read_json(path, JsonObject)
    except MalformedFileError as error:
        raise MethodError(f"expected a file of parameters that can be read, got: {error}") from error
    schema = whole.get("schema")
    if schema != SCHEMA or not isinstance(whole.get("parameters"), dict):
        raise MethodError(f"expected parameters of schema {SCHEMA}, was {schema!r}.\nFile: {path}")
    return whole["parameters"]


def with_learned_parameters(settings: SimpleNamespace, program: str) -> SimpleNamespace:
    """Return the settings of a method with the learned parameters of the file beside its program.

    Args:
        settings: What the method's card leaves to the scenario, as `load_settings` returns it.
        program: The agent's file (`__file__`).

    Raises:
        MethodError: the file cannot be read.
    """
    return SimpleNamespace(**vars(settings), **load_parameters(Path(program).with_name(PARAMETERS_FILE)))
