"""Keys that this package adds to scenarios: `participants[].start.fmu`, and the variables of a unit."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, StringConstraints

from gslcosim.base.problems import broken_rule_error
from gslcosim.base.processes import build_python_command
from gslcosim.base.scenario_keys import PARTICIPANT, PARTICIPANT_READ, ParticipantStart, ScenarioKey
from gslcosim.base.spec import Name
from gslcosim.contract.participant_messages import find_room_output

if TYPE_CHECKING:
    from gslcosim.contract.messages import Message
    from gslcosim.contract.participant import Core
    from gslcosim.runtime.setup import RunSetup
    from gslcosim.scenario.models.participants import ParticipantProgramSpec, ProgramStartSpec

# FMI allows any text as the name of a variable.
VariableName = Annotated[str, StringConstraints(min_length=1, max_length=200)]
ValuePath = Annotated[str, StringConstraints(min_length=1, max_length=400)]
# Loads a unit in a process of its own.
_HOST_MODULE = "gslcosim_fmi.host"
INPUTS = ScenarioKey[Mapping[str, str]](
    place=PARTICIPANT_READ,
    name="inputs",
    annotation=dict[VariableName, ValuePath],
    description="for a unit: by input variable the place of its value in the message, such as "
    "samples[sensor=nose].gases[gas=ethanol].mixing_ratio_ppm",
    default={},
)
OUTPUTS = ScenarioKey[Mapping[str, Mapping[str, str]]](
    place=PARTICIPANT,
    name="outputs",
    annotation=dict[Name, dict[Name, VariableName]],
    description="for a unit: by output and name the variable with its value",
    default={},
    after="answer_within_s",
)


def _build_words(unit: str) -> tuple[str, ...]:
    return (*build_python_command("-m", _HOST_MODULE), unit)


def _build_core(own: "ParticipantProgramSpec", setup: "RunSetup", types: "Mapping[str, type[Message]]") -> "Core":
    from gslcosim_fmi.core import FmuCore

    return FmuCore(own, setup, types)


def _check_start(start: "ProgramStartSpec") -> None:
    if (start.door, start.format) != ("stdio", "msgpack"):
        raise broken_rule_error(
            key="door" if start.door != "stdio" else "format",
            expected="neither door nor format beside fmu",
            found=start.door if start.door != "stdio" else start.format,
            remedy="Leave it out.",
        )


def _check_participant(own: "ParticipantProgramSpec") -> None:
    outputs = OUTPUTS.get(own)
    if UNIT_START.get(own.start) is not None:
        _check_outputs(own, outputs)
        return
    found = "reads[].inputs" if any(INPUTS.get(read) for read in own.reads) else "outputs" if outputs else ""
    if found:
        expected = "start.fmu beside variables of a unit"
        raise broken_rule_error(expected=expected, found=f"{found} of a program", remedy="Leave them out.")


def _check_outputs(own: "ParticipantProgramSpec", outputs: Mapping[str, Mapping[str, str]]) -> None:
    words = list(own.writes)
    if sorted(outputs) != sorted(words):
        raise broken_rule_error(
            key="outputs",
            expected=f"variables of the unit for each of its writes ({', '.join(sorted(words))})",
            found=", ".join(sorted(outputs)) or "none",
            remedy=f"For example outputs: {{{words[0]}: {{share: VARIABLE}}}}.",
        )
    for word, values in outputs.items():
        room = find_room_output(word)
        if room is not None and [*values] != [room.value]:
            raise broken_rule_error(
                key=f"outputs.{word}",
                expected=f"{room.value}, and nothing else",
                found=", ".join(values) or "nothing",
            )


UNIT_START = ParticipantStart[str | None](
    name="fmu",
    annotation=Annotated[str | None, Field(min_length=1)],
    description="FMU for co-simulation, FMI 2 or 3, a file relative to the scenario's folder; gslcosim loads it in a "
    "process of its own",
    after="command",
    file="an FMU",
    build_words=_build_words,
    build_core=_build_core,
    check_start=_check_start,
    check_participant=_check_participant,
    unpacks_files=True,
)
KEYS: tuple[ScenarioKey[Any], ...] = (UNIT_START, INPUTS, OUTPUTS)
