"""Core of an FMU: wires its variables to ports, and has the unit step in a process of its own."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypedDict

import msgpack  # pyright: ignore[reportMissingTypeStubs]

from gslcosim.base.errors import ContractError, SimulationFault, UsageError
from gslcosim.base.problems import Problem
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.base.untrusted_input import MalformedFileError, escape_terminal_text, validate_value
from gslcosim.contract import codec
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import Episode, Inbox
from gslcosim.contract.participant_messages import ParticipantOutputs
from gslcosim.runtime.external.core import EXIT_TIMEOUT_S, HELLO_TIMEOUT_S, ParticipantProgram, ProgramCore
from gslcosim.runtime.external.protocol import build_output
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario.models.participants import ParticipantProgramSpec
from gslcosim_fmi.calls import CallMarker
from gslcosim_fmi.description import FmuVariable, list_unpacked_folders
from gslcosim_fmi.wiring import FmuWiring, wire_fmu

# Below the limit of a frame.
_PIECE_BYTES = 512 << 10
_MAX_STATE_BYTES = 1 << 30
# A sentence, with the last lines that the unit has logged.
_MAX_FAULT_LENGTH = 2000
_msgpack: Any = msgpack


class _Answer(TypedDict, total=False):
    fault: str
    values: list[bool | int | float | str]
    n_bytes: int
    data: bytes


class FmuCore(ProgramCore):
    """Stands for an FMU in a run.

    At tick 0 the unit is initialized with the inputs of that tick. At each later tick of its period it steps up to that
    time with the inputs of its tick before, and then gets new ones: its outputs are those at the time of the tick. An
    input whose port has no message, or whose message lacks the value, keeps its value.

    A unit that can serialize its state has it in snapshots; of another they hold all inputs.

    Args:
        own: The participant in the scenario.
        setup: The run.
        types: The type of the messages on each port of the run.
    """

    def __init__(self, own: ParticipantProgramSpec, setup: RunSetup, types: Mapping[str, type[Message]]) -> None:
        super().__init__(own, setup)
        problems: list[Problem] = []
        wiring = wire_fmu(own, setup.scenario, setup.directory or Path.cwd(), types, problems)
        if wiring is None:
            raise UsageError("\n".join(f"{own.place}.{problem}" for problem in problems))
        self._wiring: FmuWiring = wiring
        self._is_kept = self._is_kept and not wiring.description.saves_state
        self._marker: CallMarker | None = None

    def state(self) -> Mapping[str, Any]:
        """Return the state of the unit, or all inputs that it was sent; see `Snapshots`."""
        if not self._wiring.description.saves_state:
            return super().state()
        program = self._running()
        n_bytes = self._request(program, "FmuSave", {}, "the size of its state", key="n_bytes")
        if not 0 <= n_bytes <= _MAX_STATE_BYTES:
            raise program.fault(f"expected a state of at most {_MAX_STATE_BYTES} bytes, was one of {n_bytes}")
        state = b""
        while len(state) < n_bytes:
            piece = {"start": len(state), "end": min(len(state) + _PIECE_BYTES, n_bytes)}
            data = self._request(program, "FmuRead", piece, "its state", key="data")
            if len(data) != piece["end"] - piece["start"]:
                raise program.fault(f"expected bytes {piece['start']} to {piece['end']} of its state, was {len(data)}")
            state += data
        room = {port: message.model_dump() for port, message in self._room_outputs.items()}
        return {"unit": state, "room": room}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Let the unit go on from its state, or step through its past again; see `Snapshots`."""
        if not self._wiring.description.saves_state:
            super().restore(state)
            return
        self._request(self._running(), "FmuRestore", {"data": bytes(state["unit"])}, "that it takes its state back")
        types = {write.port: write.message_type for write in self.spec.writes}
        self._room_outputs = {port: types[port](**fields) for port, fields in state["room"].items()}

    def close(self) -> None:
        """Terminate the unit and end its process; a fault that comes so late is noted in its log."""
        program, fault = self._program, ""
        if program is not None and not program.has_failed:
            try:
                self._send(program, "FmuEnd", _msgpack.packb({}), "that it terminates", within_s=EXIT_TIMEOUT_S)
            except SimulationFault as error:
                fault = str(error)
        super().close()
        if program is not None and fault:
            program.note(fault)
        marker, self._marker = self._marker, None
        if marker is not None:
            marker.close()

    def _start(self, episode: Episode) -> ParticipantProgram:
        del episode
        marker, descriptor = CallMarker.create()
        self._marker = marker
        program = self._program = ParticipantProgram(
            self._own,
            self._setup,
            arguments=(str(descriptor),),
            keep=(descriptor,),
            describe_place=lambda: f" from {marker.place}" if marker.place else "",
        )
        program.start()
        program.receive(ParticipantOutputs, "a process for the unit", within_s=HELLO_TIMEOUT_S)
        wiring, unit = self._wiring, self._wiring.description
        plan = {
            "version": unit.version,
            "name": self._own.name,
            "identifier": unit.identifier,
            "token": unit.token,
            "folders": list_unpacked_folders(unit.version),
            "log_categories": unit.log_categories,
            "step_ns": wiring.period_ns // wiring.n_substeps,
            "n_substeps": wiring.n_substeps,
            "inputs": _list_references(variable for variable, _, _ in wiring.inputs),
            "outputs": _list_references(variable for variable, _, _ in wiring.outputs),
            "parameters": [[[variable.reference, variable.fmi_type], value] for variable, value in wiring.parameters],
        }
        self._request(program, "FmuBegin", plan, "an instance of the unit")
        return program

    def _encode_inputs(self, tick: int, inbox: Inbox) -> bytes:
        values: list[Any] = []
        for variable, port, path in self._wiring.inputs:
            if path is None:
                value: Any = seconds_from_ticks(tick, self._setup.scenario.tick_ns)
            else:
                value = path.read(inbox[port]) if port in inbox else None
            kind = variable.kind
            value = value if value is None or kind is None else kind(value)
            if value is not None and not variable.holds(value):
                expected = f"an input {variable.name} that {variable.fmi_type} holds"
                raise self._running().fault(f"expected {expected}, was {value} at tick {tick}")
            values.append(value)
        return _msgpack.packb({"values": values})

    def _request_outputs(self, program: ParticipantProgram, tick: int, inputs: bytes) -> Mapping[str, Message]:
        what = f"the outputs of tick {tick}"
        values = self._send(program, "FmuStep", inputs, what, key="values")
        if len(values) != len(self._wiring.outputs):
            raise program.fault(f"expected {what}, {len(self._wiring.outputs)} values, was {len(values)}")
        fields: dict[str, dict[str, Any]] = {word: {} for word in self._own.writes}
        for (_, word, name), value in zip(self._wiring.outputs, values, strict=True):
            fields[word][name] = value
        try:
            return {word: build_output(word, tick, fields[word]) for word in self._own.writes}
        except ContractError as error:
            text = str(error).removeprefix("ParticipantOutputs: ")
            raise program.fault(f"{text.rstrip('.')}, at tick {tick}") from error

    def _request(
        self, program: ParticipantProgram, name: str, fields: Mapping[str, Any], what: str, *, key: str = ""
    ) -> Any:
        return self._send(program, name, _msgpack.packb(fields), what, key=key)

    # The unit is in the process that answers, and can write whatever it likes there.
    def _send(
        self,
        program: ParticipantProgram,
        name: str,
        payload: bytes,
        what: str,
        *,
        key: str = "",
        within_s: float | None = None,
    ) -> Any:
        program.check_silence(f"nothing from the unit before it is asked for {what}")
        program.send(name, payload)
        limit_s = self._own.answer_within_s if within_s is None else within_s
        received = program.receive(ParticipantOutputs, what, within_s=limit_s)
        try:
            fields = codec.unpack_untrusted("its answer", received, has_lists=True)
            answer = validate_value(fields, _Answer, place="its answer")
        except (ContractError, MalformedFileError) as error:
            raise program.fault(f"expected {what}, {error}") from error
        if "fault" in answer:
            raise program.fault(escape_terminal_text(answer["fault"][:_MAX_FAULT_LENGTH], is_one_line=True))
        if key and key not in answer:
            raise program.fault(f"expected {what}, its answer: expected the key {key}, was missing")
        return answer.get(key)


def _list_references(variables: Iterable[FmuVariable]) -> list[list[Any]]:
    return [[variable.reference, variable.fmi_type] for variable in variables]
