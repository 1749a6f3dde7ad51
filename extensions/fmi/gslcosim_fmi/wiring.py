"""Wiring of an FMU to a run: variables, types, units of measure and step sizes, and what does not fit."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.base.problems import Problem
from gslcosim.base.ticks import NS_PER_S
from gslcosim.base.units_of_measure import unit_suffix
from gslcosim.contract.messages import Message
from gslcosim.runtime.external.protocol import get_period_ticks
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.participants import ParticipantProgramSpec
from gslcosim.scenario.problems import did_you_mean
from gslcosim_fmi.description import FmuDescription, FmuVariable, read_fmu
from gslcosim_fmi.scenario_keys import INPUTS, OUTPUTS, UNIT_START
from gslcosim_fmi.units import unit_symbol
from gslcosim_fmi.value_path import ValuePath, parse_value_path

TIME_PATH = "time_s"
"""The path of simulated time, which every port has."""

_SETTABLE = ("parameter", "structuralParameter", "input")
_MAX_NAMED = 12
_TYPE_WORDS = {float: "a number", int: "a whole number", bool: "a truth value", str: "a text"}


@dataclass(frozen=True, kw_only=True)
class FmuWiring:
    """Connections of a unit in a run, as far as nothing is wrong with them.

    Attributes:
        description: Of the unit.
        inputs: Its input variables in the order of the scenario, each with its port and path; no path: the time.
        outputs: Its output variables, each with the word and the name of its value.
        parameters: Variables and values that are set before the first step.
        period_ns: Simulated time between its steps.
        n_substeps: How many steps of the unit are one.
    """

    description: FmuDescription
    inputs: tuple[tuple[FmuVariable, str, ValuePath | None], ...]
    outputs: tuple[tuple[FmuVariable, str, str], ...]
    parameters: tuple[tuple[FmuVariable, bool | float | int | str], ...]
    period_ns: int
    n_substeps: int


def wire_fmu(
    own: ParticipantProgramSpec,
    scenario: Scenario,
    directory: Path,
    types: Mapping[str, type[Message]],
    problems: list[Problem],
) -> FmuWiring | None:
    """Return the connections of a unit, None where something is wrong with them.

    Args:
        scenario: The run's.
        directory: The scenario's folder.
        types: The type of the messages on each port of the run.
        problems: What is wrong is added to it.
    """
    try:
        unit = read_fmu(directory / Path(str(UNIT_START.get(own.start))).expanduser())
    except UsageError as error:
        problems.append(build_fmu_problem("start.fmu", error))
        return None
    n_before = len(problems)
    inputs = [*_wire_inputs(own, unit, scenario, types, problems)]
    outputs = [*_wire_outputs(own, unit, problems)]
    parameters = [*_wire_parameters(own, unit, problems)]
    period_ns = get_period_ticks(own, scenario) * scenario.tick_ns
    step_ns = unit.fixed_step_ns
    if step_ns is not None and (step_ns == 0 or period_ns % step_ns):
        problems.append(_build_step_problem(step_ns, period_ns, scenario.tick_ns))
    if len(problems) > n_before:
        return None
    return FmuWiring(
        description=unit,
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        parameters=tuple(parameters),
        period_ns=period_ns,
        n_substeps=period_ns // step_ns if step_ns is not None and unit.has_fixed_steps else 1,
    )


def build_fmu_problem(where: str, error: UsageError) -> Problem:
    """Return the problem at a key of a participant that an error whose text is "expected …, was …" tells."""
    expected, _, found = str(error).removeprefix("expected ").partition(", was ")
    return Problem(where=where, expected=expected, found=found.rstrip("."))


def _build_step_problem(step_ns: int, period_ns: int, tick_ns: int) -> Problem:
    step_s = step_ns / NS_PER_S
    remedy = "The unit has to be exported with another step."
    for n in range(1, 1001):
        if step_ns and n * tick_ns % step_ns == 0:
            remedy = f"Set period_s: {n * tick_ns / NS_PER_S:g}, or export the unit with another step."
            break
    return Problem(
        where="period_s",
        expected=f"a whole number of the unit's steps of {step_s:g} s",
        found=f"{period_ns / NS_PER_S:g} s",
        remedy=remedy,
    )


def _wire_inputs(
    own: ParticipantProgramSpec,
    unit: FmuDescription,
    scenario: Scenario,
    types: Mapping[str, type[Message]],
    problems: list[Problem],
) -> Iterator[tuple[FmuVariable, str, ValuePath | None]]:
    seen: set[str] = set()
    for j, read in enumerate(own.reads):
        for name, text in INPUTS.get(read).items():
            where = f"reads[{j}].inputs.{name}"
            variable = _find_variable(unit, name, where, ("input",), problems)
            if variable is None:
                continue
            if name in seen:
                problems.append(Problem(where=where, expected="each variable once", found=f"'{name}' twice"))
                continue
            seen.add(name)
            if text == TIME_PATH:
                problems += _check_value(variable, frozenset((float,)), TIME_PATH, where)
                yield variable, read.port, None
                continue
            if read.port not in types:
                continue  # which another check reports
            try:
                path = parse_value_path(text, types[read.port])
            except UsageError as error:
                problems.append(build_fmu_problem(where, error))
                continue
            problems += _check_names(path, scenario, where)
            problems += _check_value(variable, path.kinds, path.field, where)
            yield variable, read.port, path


def _wire_outputs(
    own: ParticipantProgramSpec, unit: FmuDescription, problems: list[Problem]
) -> Iterator[tuple[FmuVariable, str, str]]:
    for word, values in OUTPUTS.get(own).items():
        for value_name, name in values.items():
            where = f"outputs.{word}.{value_name}"
            variable = _find_variable(unit, name, where, ("output", "local", "calculatedParameter"), problems)
            if variable is None:
                continue
            if variable.kind in (None, str):
                found = f"{name}, which is {_describe_type(variable)}"
                problems.append(Problem(where=where, expected="a number or a truth value", found=found))
                continue
            problems += _check_measure(variable, value_name, where)
            yield variable, word, value_name


def _wire_parameters(
    own: ParticipantProgramSpec, unit: FmuDescription, problems: list[Problem]
) -> Iterator[tuple[FmuVariable, bool | float | int | str]]:
    for name, value in own.parameters.items():
        where = f"parameters.{name}"
        variable = _find_variable(unit, name, where, _SETTABLE, problems)
        if variable is None:
            continue
        kind = variable.kind
        is_right = type(value) is kind or (kind is float and type(value) is int)
        if kind is None or not is_right or isinstance(value, tuple):
            expected = _TYPE_WORDS[kind] if kind is not None else "a variable with one number, truth value or text"
            problems.append(Problem(where=where, expected=expected, found=repr(value)))
            continue
        if not variable.holds(value):
            expected = f"a number that {variable.fmi_type} holds"
            problems.append(Problem(where=where, expected=expected, found=repr(value)))
            continue
        yield variable, value


def _find_variable(
    unit: FmuDescription, name: str, where: str, causalities: tuple[str, ...], problems: list[Problem]
) -> FmuVariable | None:
    variable = unit.variables.get(name)
    names = unit.list_names(causalities[0])
    what = f"{causalities[0]} of {unit.model}"
    if variable is None:
        listed = ", ".join(names[:_MAX_NAMED]) + (" …" if len(names) > _MAX_NAMED else "")
        expected = f"an {what} ({listed})" if what[0] in "io" else f"a {what} ({listed})"
        remedy = did_you_mean(name, names)
        problems.append(Problem(where=where, expected=expected, found=f"'{name}'", remedy=remedy))
    elif variable.causality not in causalities or variable.variability == "constant":
        kind = "a constant" if variable.variability == "constant" else f"of causality {variable.causality}"
        problems.append(Problem(where=where, expected=f"an {what}".replace("an p", "a p"), found=f"'{name}', {kind}"))
    else:
        return variable
    return None


def _check_names(path: ValuePath, scenario: Scenario, where: str) -> Iterable[Problem]:
    agents = {agent.name: agent for agent in scenario.agents}
    wanted = path.find_names("agent")
    sensors = sorted(
        {sensor.name for name, agent in agents.items() if not wanted or name in wanted for sensor in agent.sensors}
    )
    known = {
        "agent": sorted(agents),
        "sensor": sensors,
        "gas": sorted(scenario.substances),
        "probe": [probe.name for probe in scenario.probes or ()],
    }
    for key, names in known.items():
        for name in path.find_names(key):
            if name not in names:
                yield Problem(
                    where=where,
                    expected=f"one of this scenario's ({', '.join(names)}) for {key}",
                    found=f"'{name}'",
                    remedy=did_you_mean(name, names),
                )


def _check_value(variable: FmuVariable, kinds: frozenset[type], field: str, where: str) -> list[Problem]:
    kind = variable.kind
    allowed = {float: {float, int, bool}, int: {int, bool}, bool: {bool}, str: {str}}
    if kind is None or not kinds & allowed[kind]:
        words = " or ".join(sorted(_TYPE_WORDS[each] for each in kinds))
        found = f"{variable.name}, which is {_describe_type(variable)}"
        return [Problem(where=where, expected=f"a variable that takes {words}, as {field} is", found=found)]
    return [*_check_measure(variable, field, where)]


def _describe_type(variable: FmuVariable) -> str:
    return variable.fmi_type if variable.is_scalar else f"an array of {variable.fmi_type}"


def _check_measure(variable: FmuVariable, field: str, where: str) -> Iterator[Problem]:
    measure = variable.measure
    if measure is None or not unit_suffix(field) or measure.is_that_of(field):
        return
    yield Problem(
        where=where,
        expected=f"a variable in {unit_symbol(field)}, as the end of {field} says",
        found=f"{variable.name} in {measure.name}",
        remedy="Convert it in the unit.",
    )
