"""Files of what was learned: policies as arrays with a card in one `.npz`, and parameters of methods as JSON."""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import MethodError, UsageError
from gslcosim.base.files import replace_file
from gslcosim.base.untrusted_input import JsonObject, MalformedFileError, parse_json, read_json, read_npz
from gslcosim.contract.messages import ParameterValue
from gslcosim_search.learned.policy import ActionSettings, ArrayPolicy, Policy, PolicyError
from gslcosim_search.learned.recurrent_networks import CtrnnPolicy, GruPolicy
from gslcosim_search.learned.value_table import ValueTable

POLICY_SCHEMA = "gslcosim/policy/1"
CARD = "card"
# What `gslcosim` writes itself; all else of a card says how the policy came to be.
OWN_KEYS = ("schema", "kind", "observation_names", "action", "settings")
KINDS: dict[str, type[ArrayPolicy]] = {kind.kind: kind for kind in (CtrnnPolicy, GruPolicy, ValueTable)}
PARAMETERS_FILE = "parameters.json"
PARAMETERS_SCHEMA = "gslcosim/parameters/1"


def save_policy(path: str | Path, policy: Policy, card: Mapping[str, Any]) -> None:
    """Write a policy with a card that says how it came to be: data, seeds, budget, versions, the command.

    The same policy and card make the same bytes.

    Args:
        path: The file, `.npz`; a reader sees the old one or the new one, never a part.
        card: Plain values under names of their own.

    Raises:
        UsageError: the name ends otherwise, the card has a name that is taken, or the file cannot be written.
        PolicyError: the policy is of a kind that has files of its own, such as ONNX.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise UsageError(f"expected a policy's file to end with .npz, was {path.name}.\nFile: {path}")
    if taken := sorted(set(card).intersection(OWN_KEYS)):
        raise UsageError(f"card: expected other names than {', '.join(OWN_KEYS)}, was {', '.join(taken)}.")
    if not isinstance(policy, ArrayPolicy):
        raise PolicyError(f"kind: expected one of {', '.join(KINDS)}, was {policy.kind}, which has files of its own.")
    whole = {
        "schema": POLICY_SCHEMA,
        "kind": policy.kind,
        "observation_names": list(policy.observation_names),
        "action": policy.action.plain,
        "settings": policy.settings,
        **card,
    }
    file = io.BytesIO()
    text = np.array(json.dumps(whole, indent=1, ensure_ascii=False))
    np.savez_compressed(file, allow_pickle=False, **{CARD: text, **policy.arrays})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path.parent, path.name, file.getvalue())
    except OSError as error:
        raise UsageError(f"expected a file that can be written, got: {error}.\nFile: {path}") from error


def load_policy(path: str | Path) -> Policy:
    """Return the policy of a file: `.npz`, or `.onnx` (see `onnx_policy`).

    Raises:
        PolicyError: the file cannot be read, is corrupt, or lacks an array; the text names file and entry.
    """
    path = Path(path)
    try:
        if path.suffix == ".onnx":
            from gslcosim_search.learned.onnx_policy import load_onnx

            return load_onnx(path)
        card, arrays = _read(path)
        return _policy_of(card, arrays)
    except PolicyError as error:
        raise PolicyError(f"{error}\nFile: {path}") from error


def read_policy_card(path: str | Path) -> dict[str, Any]:
    """Return the card of a policy's `.npz` file.

    Raises:
        PolicyError: as `load_policy`.
    """
    try:
        return _read(Path(path))[0]
    except PolicyError as error:
        raise PolicyError(f"{error}\nFile: {path}") from error


def read_observation_names(card: Mapping[str, Any]) -> tuple[str, ...]:
    """Return which observations a card names.

    Raises:
        PolicyError: it names none, or what it names are no words.
    """
    names = card.get("observation_names")
    if not isinstance(names, list | tuple) or not names or not all(isinstance(name, str) for name in names):
        raise PolicyError(f"observation_names: expected a list of names, was {names!r}.")
    if len(set(names)) != len(names):
        raise PolicyError("observation_names: expected each name once, was one twice.")
    return tuple(names)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    if not path.is_file():
        raise PolicyError("expected the file of a policy, was none there.")
    try:
        arrays = read_npz(path)
    except (OSError, ValueError) as error:
        raise PolicyError(
            f"expected a .npz file that can be read, got: {error}. It is corrupt; make it again."
        ) from error
    if CARD not in arrays:
        raise PolicyError(f"{CARD}: expected an entry, was missing. It has {', '.join(arrays) or 'none'}.")
    text = arrays.pop(CARD)
    try:
        card = parse_json(str(text[()]), JsonObject, place=CARD)
    except (IndexError, MalformedFileError) as error:
        raise PolicyError(f"{CARD}: expected JSON, got: {error}") from error
    if card.get("schema") != POLICY_SCHEMA:
        raise PolicyError(f"{CARD}.schema: expected {POLICY_SCHEMA}, was {card.get('schema')!r}.")
    return card, arrays


def _policy_of(card: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Policy:
    kind = card.get("kind")
    if kind not in KINDS:
        raise PolicyError(f"{CARD}.kind: expected one of {', '.join(KINDS)}, was {kind!r}.")
    settings = card.get("settings", {})
    if not isinstance(settings, dict):
        raise PolicyError(f"{CARD}.settings: expected a map, was {settings!r}.")
    names, action = read_observation_names(card), ActionSettings.of(card.get("action"))
    return KINDS[kind].of_arrays(names, action, arrays, settings)


def save_parameters(
    folder: Path, method: str, parameters: Mapping[str, ParameterValue], card: Mapping[str, Any]
) -> None:
    """Write parameters of a method into a folder, with a card that says how they came to be.

    Args:
        folder: Where; it is there.
        parameters: As scenarios take them.
        card: Plain values: data, seeds, budget, versions, the command.
    """
    whole = {"schema": PARAMETERS_SCHEMA, "method": method, "parameters": dict(parameters), **card}
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
    if schema != PARAMETERS_SCHEMA or not isinstance(whole.get("parameters"), dict):
        raise MethodError(f"expected parameters of schema {PARAMETERS_SCHEMA}, was {schema!r}.\nFile: {path}")
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
