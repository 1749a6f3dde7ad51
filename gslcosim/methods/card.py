"""Card of a search method: a YAML file beside its program, kinds of instruments, and the check of its needs."""

from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self, cast

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from pydantic_core import ErrorDetails

from gslcosim.base.bundled import CARD_FILE
from gslcosim.base.errors import MethodError
from gslcosim.base.files import read_regular_file
from gslcosim.base.problems import Problem, broken_rule_error
from gslcosim.base.quantities import BEAM_QUANTITY, ESTIMATE_QUANTITY, POINT_GAS_QUANTITIES
from gslcosim.base.yaml_core import CoreLoader
from gslcosim.contract.messages import ParameterValue, SensorDescription

WIND_QUANTITY = "apparent_wind"
RANGE_QUANTITY = "range"
CAMERA_QUANTITY = "picture"

# For each kind the quantities of its sensors, and an example for a scenario. Methods map a reading to the place of the
# sensor, so that a beam is no gas for them.
INSTRUMENT_KINDS: dict[str, tuple[Collection[str], str]] = {
    "gas": (POINT_GAS_QUANTITIES, "{model: tgs2600, name: nose}"),
    "gas_ohm": (("resistance",), "{model: tgs2600, name: nose}"),
    "gas_ppm": (("mixing_ratio", ESTIMATE_QUANTITY), "{model: pid, name: nose}"),
    "wind": ((WIND_QUANTITY,), "{model: anemometer, name: wind}"),
    "range": ((RANGE_QUANTITY,), "{model: four_range_finders, name: ranges}"),
    "camera": ((CAMERA_QUANTITY,), "{model: camera, name: eye}"),
}
# Parameters of several methods, one file each; a card adopts them by `includes`.
SHARED_PARAMETERS = Path(__file__).with_name("parameters")
FAMILIES = ("anchor", "reactive", "swarm", "bayesian", "information", "map", "learned", "vision")
Family = Literal["anchor", "reactive", "swarm", "bayesian", "information", "map", "learned", "vision"]
Knowledge = Literal["map", "plume", "source"]
ParameterType = Literal["float", "int", "bool", "text", "floats", "file"]
Count = Annotated[int, Field(ge=1, le=100)]
_TYPE_WORDS: dict[ParameterType, str] = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "text": "a word",
    "floats": "a list of numbers",
    "file": "a name or a path",
}


def count_instruments(kind: str, sensors: Iterable[SensorDescription]) -> int:
    """Return the number of sensors of a kind of `INSTRUMENT_KINDS`; the estimate of a MOX sensor counts as ppm."""
    return sum(sensor.quantity in INSTRUMENT_KINDS[kind][0] for sensor in sensors)


class _CardPart(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Parameter(_CardPart):
    """One setting of a method: default, allowed values, unit, origin of the number, and its effect.

    `type` follows from the default; it is given if the default is null. `min` and `max` bound numbers, and each number
    of a list. `choices` are all allowed values. A `file` is a name in the method's own list, or the path of a file,
    which has an ending and has to exist before a run.
    """

    default: bool | int | float | str | tuple[float, ...] | None
    type: ParameterType | None = None
    min: float | None = None
    max: float | None = None
    choices: tuple[bool | int | float | str, ...] = ()
    unit: str = "1"
    origin: str
    meaning: str

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.default is None and self.type is None:
            raise broken_rule_error(
                key="type", expected="a type beside default: null", found="none", remedy="For example type: float."
            )
        if self.default is not None and (problem := self.problem_of(self.default)):
            raise broken_rule_error(key="default", expected=problem, found=f"{self.default!r}")
        return self

    @property
    def kind(self) -> ParameterType:
        """The type of its values."""
        if self.type is not None:
            return self.type
        kinds: dict[type, ParameterType] = {bool: "bool", int: "int", float: "float", str: "text"}
        return kinds.get(type(self.default), "floats")

    def problem_of(self, value: object) -> str | None:
        """Return the expected value in place of one that is not allowed, else None."""
        if value is None:
            return None if self.default is None else f"{_TYPE_WORDS[self.kind]}"
        if not _is_of_type(value, self.kind):
            return _TYPE_WORDS[self.kind]
        if self.choices and value not in self.choices:
            return f"one of {', '.join(map(str, self.choices))}"
        numbers = value if isinstance(value, tuple | list) else (value,)
        for number in numbers:
            if isinstance(number, int | float) and not isinstance(number, bool):
                if self.min is not None and number < self.min:
                    return f"at least {self.min:g} {self._shown_unit}".rstrip()
                if self.max is not None and number > self.max:
                    return f"at most {self.max:g} {self._shown_unit}".rstrip()
        return None

    def parsed(self, value: Any) -> Any:
        """Return an allowed value in the method's type: whole numbers become reals where reals are expected."""
        if value is None:
            return None
        if self.kind == "float":
            return float(value)
        return tuple(float(number) for number in value) if self.kind == "floats" else value

    @property
    def _shown_unit(self) -> str:
        return "" if self.unit == "1" else self.unit


def _is_of_type(value: object, kind: ParameterType) -> bool:
    is_bool = isinstance(value, bool)
    if kind == "bool":
        return is_bool
    if kind in ("text", "file"):
        return isinstance(value, str)
    if kind == "int":
        return isinstance(value, int) and not is_bool
    if kind == "float":
        return isinstance(value, int | float) and not is_bool
    return isinstance(value, tuple | list) and all(_is_of_type(number, "float") for number in value)


class Needs(_CardPart):
    """Minimum needs of a method: sensors by kind with their number, granted knowledge, and a radio channel."""

    sensors: dict[str, Count] = Field(default_factory=dict[str, Count])
    knows: tuple[Knowledge, ...] = ()
    radio: bool = False

    # A list of kinds stands for one of each.
    @field_validator("sensors", mode="before", json_schema_input_type=list[str] | dict[str, Count])
    @classmethod
    def _from_list(cls, value: Any) -> Any:
        return dict.fromkeys(value, 1) if isinstance(value, list | tuple) else value

    @field_validator("sensors")
    @classmethod
    def _check_kinds(cls, sensors: dict[str, int]) -> dict[str, int]:
        unknown = [kind for kind in sensors if kind not in INSTRUMENT_KINDS]
        if unknown:
            raise broken_rule_error(expected=f"kinds among {', '.join(INSTRUMENT_KINDS)}", found=", ".join(unknown))
        return sensors


class MethodCard(_CardPart):
    """A search method: its description, its needs, and its settings.

    `program` names the class of a Python agent, `module:Class`, if no agent.py is beside the card. `robots` is the
    number of robots that run it together: one number, or minimum and maximum. `decision_limit_ms` is the limit of a
    decision's time at the 95th percentile. `files` names the files and folders beside the card that a sandbox shows the
    program, apart from its code. In a file, `includes` names files of `SHARED_PARAMETERS` whose parameters the method
    has as well.
    """

    schema_: Literal["gslcosim/method/1"] = Field(alias="schema")
    title: str
    family: Family
    summary: str
    paper: str
    program: Annotated[str, Field(pattern=r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$")] | None = None
    needs: Needs = Needs()
    robots: Count | tuple[Count, Count] = 1
    dimensions: Literal[2, 3] = 2
    declares: bool = False
    believes: bool = False
    decision_limit_ms: Annotated[float, Field(gt=0)] = 1.0
    files: tuple[Annotated[str, Field(min_length=1)], ...] = ()
    parameters: dict[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")], Parameter] = Field(
        default_factory=dict[str, Parameter]
    )

    @property
    def is_blind(self) -> bool:
        """True if the card declares that the method uses no sensor, no knowledge and no radio."""
        is_said = "needs" in self.model_fields_set and "sensors" in self.needs.model_fields_set
        return is_said and not (self.needs.sensors or self.needs.knows or self.needs.radio)

    def defaults(self) -> dict[str, Any]:
        """Return the default of each parameter."""
        return {name: parameter.parsed(parameter.default) for name, parameter in self.parameters.items()}

    def settings(self, given: dict[str, ParameterValue]) -> "MappingProxyType[str, Any]":
        """Return the value of each parameter: the given ones, the others by default; all must be allowed."""
        parsed = {name: self.parameters[name].parsed(value) for name, value in given.items()}
        return MappingProxyType({**self.defaults(), **parsed})


def find_card_beside(program: Path) -> MethodCard | None:
    """Return the card in the folder of an agent's program, or None if there is none."""
    path = program.parent / CARD_FILE
    return load_card(path) if path.is_file() else None


def load_card(path: Path) -> MethodCard:
    """Return the method card of a file."""
    try:
        stat = path.stat()
    except OSError as error:
        raise MethodError(f"expected a method card that can be read, got: {error}.\nFile: {path}") from error
    return _loaded(path.resolve(), stat.st_mtime_ns, stat.st_size)


# Read once per process as long as the file is unchanged: a suite runs the same methods thousands of times.
@lru_cache(maxsize=256)
def _loaded(path: Path, changed_ns: int, n_bytes: int) -> MethodCard:
    del changed_ns, n_bytes
    try:
        fields = yaml.load(read_regular_file(path).decode(), Loader=CoreLoader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise MethodError(f"expected a method card that can be read, got: {error}.\nFile: {path}") from error
    if not isinstance(fields, dict):
        raise MethodError(f"expected a method card (a YAML map), was {type(fields).__name__}.\nFile: {path}")
    try:
        return MethodCard.model_validate(_with_included(cast(dict[str, Any], fields), path))
    except ValidationError as error:
        lines = [_describe_error(problem) for problem in error.errors(include_url=False)]
        raise MethodError("the method card is wrong: " + "; ".join(lines) + f".\nFile: {path}") from error


def _describe_error(problem: ErrorDetails) -> str:
    keys = [*problem["loc"], *filter(None, [problem.get("ctx", {}).get("key")])]
    said = problem["msg"].rstrip(". ")
    return f"{'.'.join(map(str, keys))}: {said[:1].lower()}{said[1:]}"


# A card's own parameters come first, and replace included ones of their name.
def _with_included(fields: dict[str, Any], path: Path) -> dict[str, Any]:
    included, own = fields.get("includes"), fields.get("parameters", {})
    if included is None or not isinstance(own, dict):
        return fields
    if not is_list_of_shared_parameters(included):
        raise MethodError(
            f"the method card is wrong: includes: expected a list of {', '.join(list_shared_parameters())}, was "
            f"{included!r}.\nFile: {path}"
        )
    parameters: dict[str, Any] = {}
    for name in cast(list[str], included):
        parameters |= yaml.load((SHARED_PARAMETERS / f"{name}.yaml").read_text(encoding="utf-8"), Loader=CoreLoader)
    return {key: value for key, value in fields.items() if key != "includes"} | {
        "parameters": own | {name: value for name, value in parameters.items() if name not in own}
    }


def list_shared_parameters() -> list[str]:
    """Return the names that a card may include."""
    return sorted(file.stem for file in SHARED_PARAMETERS.glob("*.yaml"))


def is_list_of_shared_parameters(value: object) -> bool:
    """Return whether a value is a list of names that a card may include."""
    return isinstance(value, list) and all(name in list_shared_parameters() for name in cast(list[object], value))


def find_unmet_needs(
    card: MethodCard,
    *,
    sensors: Iterable[SensorDescription],
    knows: Collection[str],
    n_channels: int,
    parameters: Mapping[str, Any],
) -> list[Problem]:
    """Return all reasons for which a method cannot run.

    Args:
        sensors: Instruments of the vehicle, as described in a briefing.
        knows: Granted knowledge: `map`, `plume`, `source`.
        n_channels: Number of the agent's radio channels.
        parameters: The scenario's settings for the method.
    """
    problems = [*_missing_sensors(card, tuple(sensors))]
    problems += [
        Problem(
            where="knows",
            expected=f"{item}: true for {card.title}",
            found="not granted",
            remedy=f"Add knows: {{{item}: true}} to the agent.",
        )
        for item in card.needs.knows
        if item not in knows
    ]
    if card.needs.radio and not n_channels:
        radio = Problem(
            where="name",
            expected=f"an agent on a radio channel for {card.title}",
            found="one without",
            remedy="Add for example channels: [{name: radio}] to the scenario.",
        )
        problems.append(radio)
    return [*problems, *_wrong_parameters(card, parameters)]


def _missing_sensors(card: MethodCard, sensors: tuple[SensorDescription, ...]) -> Iterable[Problem]:
    beams = [sensor.model for sensor in sensors if sensor.quantity == BEAM_QUANTITY]
    for kind, n_needed in card.needs.sensors.items():
        n_found = count_instruments(kind, sensors)
        if n_found < n_needed:
            # Estimates have descriptions of their own, beside the sensor's.
            models = [sensor.model for sensor in sensors if not sensor.quantity.startswith("estimated_")]
            along = f" It measures at a point; {beams[0]} measures along a beam." if beams and "gas" in kind else ""
            yield Problem(
                where="sensors",
                expected=f"at least {n_needed} of kind {kind} for {card.title}",
                found=f"{n_found} ({', '.join(models) or 'no sensors'})",
                remedy=f"Add for example {INSTRUMENT_KINDS[kind][1]}.{along}",
            )


def _wrong_parameters(card: MethodCard, parameters: Mapping[str, Any]) -> Iterable[Problem]:
    for name, value in parameters.items():
        parameter = card.parameters.get(name)
        if parameter is None:
            known = ", ".join(card.parameters) or "none"
            nearest = get_close_matches(name, card.parameters, n=1)
            hint = f"Did you mean {nearest[0]}?" if nearest else "Leave it out."
            expected = f"a parameter of {card.title} ({known})"
            yield Problem(where=f"parameters.{name}", expected=expected, found=f"'{name}'", remedy=hint)
        elif expected := parameter.problem_of(value):
            found = f"{value!r}" if isinstance(value, str) else f"{value}"
            remedy = f"Its default is {parameter.default}."
            yield Problem(where=f"parameters.{name}", expected=expected, found=found, remedy=remedy)
