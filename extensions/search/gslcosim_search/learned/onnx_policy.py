"""ONNX policies of other programs: a model, and beside it or in it the meaning of its numbers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import yaml
from numpy.typing import NDArray
from typing_extensions import override

from gslcosim.base.files import read_regular_file
from gslcosim.base.untrusted_input import JsonObject, MalformedFileError, parse_json
from gslcosim.base.yaml_core import CoreLoader
from gslcosim_search.learned.policy import Actions, ActionSettings, Floats, Policy, PolicyError

# The key of the model's metadata under which JSON says what a file beside the model may say too.
METADATA_KEY = "gslcosim"
_KEYS = ("observation_names", "action", "observation", "output", "memory")


class OnnxPolicy(Policy):
    """A model that `onnxruntime` runs on one thread, so that the same numbers come out each time on one machine.

    The model takes observations, (n, k) float32, and puts out numbers between -1 and 1, (n, numbers), which are
    clipped, or for an action with choices their values, (n, choices), or the choice itself as whole numbers, (n,).
    Memories are pairs of an input and an output, of any shape whose axis without a fixed size, or of size 1 where all
    are fixed, counts agents.

    Args:
        observation_names: See `Policy`.
        action: See `Policy`.
        model: The bytes of the model.
        observation: Name of the input of observations; absent: the first that is no memory.
        output: Name of the output with actions; absent: the first that is no memory.
        memory: Names of inputs, and of the outputs that are the next inputs.

    Raises:
        PolicyError: onnxruntime is missing, or the model cannot be read, or has other inputs or outputs.
    """

    kind: ClassVar[str] = "onnx"

    def __init__(
        self,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        *,
        model: bytes,
        observation: str | None = None,
        output: str | None = None,
        memory: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(observation_names, action)
        self._session = open_session(model)
        self._pairs = dict(memory or {})
        inputs = {item.name: item for item in self._session.get_inputs()}
        outputs = [item.name for item in self._session.get_outputs()]
        self._observation = _one("observation", observation, [name for name in inputs if name not in self._pairs])
        self._output = _one("output", output, [name for name in outputs if name not in self._pairs.values()])
        _check("memory", self._pairs, inputs)
        _check("memory", self._pairs.values(), outputs)
        if others := sorted(set(inputs).difference(self._pairs, (self._observation,))):
            raise PolicyError(f"inputs: expected observation and memory alone, was {', '.join(others)} too.")
        shape = inputs[self._observation].shape
        if len(shape) != 2 or (isinstance(shape[1], int) and shape[1] != len(self.observation_names)):
            raise PolicyError(
                f"{self._observation}: expected shape (n, {len(self.observation_names)}) for the observation_names, "
                f"was {tuple(shape)}."
            )
        self._shapes = {name: list(inputs[name].shape) for name in self._pairs}
        self._sizes = {name: _size(shape) for name, shape in self._shapes.items()}
        self._takes_many = not isinstance(shape[0], int) and not any(
            all(isinstance(size, int) for size in each) for each in self._shapes.values()
        )

    @override
    def memory(self, n: int) -> Floats:
        return np.zeros((n, sum(self._sizes.values())), np.float32)

    @override
    def act(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        if self._takes_many or len(observations) == 1:
            return self._run(observations, memory)
        parts = [self._run(observations[i : i + 1], memory[i : i + 1]) for i in range(len(observations))]
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])

    def _run(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        n, fed, place = len(observations), {self._observation: np.ascontiguousarray(observations, np.float32)}, 0
        for name, size in self._sizes.items():
            shape, axis = self._shapes[name], _axis_of_agents(self._shapes[name])
            rows = memory[:, place : place + size].reshape(n, *(each for i, each in enumerate(shape) if i != axis))
            fed[name] = np.ascontiguousarray(np.moveaxis(rows, 0, axis))
            place += size
        found, *after = self._session.run([self._output, *self._pairs.values()], fed)
        rows = [
            np.moveaxis(one, _axis_of_agents(self._shapes[name]), 0).reshape(n, -1)
            for name, one in zip(self._pairs, after)
        ]
        return self._actions(found, n), np.concatenate(rows, axis=1).astype(np.float32) if rows else memory

    def _actions(self, found: NDArray[Any], n: int) -> Actions:
        n_choices = self.action.n_choices
        if n_choices and found.size == n and found.dtype.kind in "iu":
            return np.clip(found.reshape(n).astype(np.int64), 0, n_choices - 1)
        if found.shape != (n, self.action.n_outputs):
            raise PolicyError(
                f"{self._output}: expected shape ({n}, {self.action.n_outputs}) for action {self.action.kind}, was "
                f"{found.shape}."
            )
        return np.argmax(found, axis=1) if n_choices else np.clip(found.astype(np.float32), -1.0, 1.0)


def load_onnx(path: Path) -> OnnxPolicy:
    """Return the policy of a model.

    What its numbers mean says a file beside it of the same name with `.yaml` or `.json`, or JSON in the model's
    metadata under `gslcosim`: `observation_names`, `action` (kind, step_m, speed_m_s, hold_s, frame, shield_m), and
    where the model has several inputs or outputs `observation`, `output`, and `memory`, a map from inputs to outputs.

    Raises:
        PolicyError: something of it is missing or wrong, or onnxruntime is not installed.
    """
    if not path.is_file():
        raise PolicyError("expected the model of a policy, was none there.")
    model = read_regular_file(path)
    meaning = _meaning_of(path, model)
    if strange := sorted(set(meaning).difference(_KEYS)):
        raise PolicyError(f"expected {', '.join(_KEYS)} to say what a model's numbers mean, was {', '.join(strange)}.")
    names = meaning.get("observation_names")
    if not isinstance(names, list | tuple) or not names or not all(isinstance(name, str) for name in names):
        raise PolicyError(f"observation_names: expected a list of names, was {names!r}.")
    memory = meaning.get("memory") or {}
    if not isinstance(memory, Mapping):
        raise PolicyError(f"memory: expected a map from inputs to outputs, was {memory!r}.")
    return OnnxPolicy(
        tuple(names),
        ActionSettings.of(meaning.get("action")),
        model=model,
        observation=meaning.get("observation"),
        output=meaning.get("output"),
        memory={str(key): str(value) for key, value in memory.items()},
    )


def open_session(model: bytes) -> Any:
    """Return the model in onnxruntime, on one thread.

    Raises:
        PolicyError: onnxruntime is missing or cannot read it.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise PolicyError(
            "expected onnxruntime to fly a policy in ONNX, was none. Install it: pip install 'gslcosim-search[onnx]'"
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 3
    # It raises classes of its own that no module names.
    try:
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise PolicyError(f"expected a model in ONNX that onnxruntime can read, got: {error}.") from error


def _meaning_of(path: Path, model: bytes) -> Mapping[str, Any]:
    beside = [path.with_suffix(suffix) for suffix in (".yaml", ".json")]
    for file in beside:
        if file.is_file():
            try:
                meaning = yaml.load(read_regular_file(file).decode(), Loader=CoreLoader)
            except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
                raise PolicyError(f"{file.name}: expected YAML or JSON that can be read, got: {error}.") from error
            break
    else:
        text = open_session(model).get_modelmeta().custom_metadata_map.get(METADATA_KEY)
        if text is None:
            names = " or ".join(file.name for file in beside)
            raise PolicyError(
                f"expected {names} beside the model, or {METADATA_KEY} in its metadata, was neither. It says which "
                "observation_names the model takes and what its action means."
            )
        try:
            meaning = parse_json(text, JsonObject, place=f"metadata.{METADATA_KEY}")
        except MalformedFileError as error:
            raise PolicyError(str(error)) from error
    if not isinstance(meaning, Mapping):
        raise PolicyError(f"expected a map that says what a model's numbers mean, was {type(meaning).__name__}.")
    return meaning


def _one(key: str, meaning: str | None, names: list[str]) -> str:
    if meaning is not None:
        _check(key, (meaning,), names)
        return meaning
    if not names:
        raise PolicyError(f"{key}: expected one in the model, was none.")
    return names[0]


def _check(key: str, meaning: Any, names: Any) -> None:
    if strange := [name for name in meaning if name not in names]:
        raise PolicyError(f"{key}: expected names among {', '.join(names)}, was {', '.join(strange)}.")


# The first without a fixed size, or else the first of size 1.
def _axis_of_agents(shape: list[Any]) -> int:
    free = [i for i, size in enumerate(shape) if not isinstance(size, int)]
    return free[0] if free else shape.index(1) if 1 in shape else 0


def _size(shape: list[Any]) -> int:
    axis = _axis_of_agents(shape)
    others = [size for i, size in enumerate(shape) if i != axis]
    if not all(isinstance(size, int) for size in others):
        raise PolicyError(f"memory: expected one axis without a fixed size, was shape {tuple(shape)}.")
    return int(np.prod(others, dtype=np.int64))
