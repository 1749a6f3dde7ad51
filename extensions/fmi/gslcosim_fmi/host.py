"""Process of an FMU: unpacks it, loads it with fmpy, and lets it step as its core asks, over standard streams.

    python -m gslcosim_fmi.host UNIT DESCRIPTOR

Frames are a length in 4 bytes, big-endian, and a msgpack map. Each request has one answer: what was asked for, or
`fault`, a sentence. What the unit itself prints goes to the standard error.
"""

# pyright: basic

import os
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import msgpack

from gslcosim.base.files import remove_tree
from gslcosim.contract.length_prefix import prefix_length, read_frame
from gslcosim_fmi.calls import CallMarker

STATUSES = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
_DISCARD = 2
_MAX_LOG_LINES, _MAX_LINE_LENGTH, _MAX_LOGGED = 3, 300, 10_000
_FAULT_CATEGORIES = ("warning", "discard", "error", "fatal")
# Of a step, for rounding of times that a unit computes itself.
_TIME_TOLERANCE = 1e-6
# By type the value references, and their places among all values.
_Group = tuple[list[int], list[int]]


class FmuError(Exception):
    """Fault of a unit; the text is a sentence without its full stop."""


class LoadedFmu:
    """A unit in this process.

    Args:
        plan: What its core has sent: version, identifier, token, variables, parameters, step and substeps.
        folder: Where it is unpacked.
        marker: Where it is noted which function it is in.
        log: Gets the last lines that it logs besides those of status OK.
    """

    def __init__(self, plan: Mapping[str, Any], folder: Path, marker: CallMarker, log: deque[str]) -> None:
        self._version: int = plan["version"]
        self._step_ns: int = plan["step_ns"]
        self._n_substeps: int = plan["n_substeps"]
        self._marker = marker
        self._log = log
        self._n_logged = 0
        self._n_steps = 0
        self._is_instantiated = False
        self._unit = self._load(plan, folder)
        self._call_directly = self._unit._call
        # All functions of FMI go through it.
        self._unit._call = self._call
        self._instantiate(plan["log_categories"])
        self._inputs = _group(plan["inputs"])
        self._outputs = _group(plan["outputs"])
        self._n_outputs = len(plan["outputs"])
        for variable, value in plan["parameters"]:
            self._set({variable[1]: ([variable[0]], [0])}, [value])

    def step(self, values: Sequence[Any]) -> list[Any]:
        """Return the outputs at the end of the next step, and let the unit hold new inputs from there on.

        Args:
            values: Of all inputs; None keeps what the unit has.
        """
        if self._n_steps == 0:
            self._enter_initialization()
            self._set(self._inputs, values)
            self._unit.exitInitializationMode()
            outputs = self._get()
        else:
            self._do_steps()
            outputs = self._get()
            self._set(self._inputs, values)
        self._n_steps += 1
        return outputs

    def save_state(self) -> bytes:
        """Return the state of the unit, and how many steps it has done."""
        state = self._unit.getFMUState()
        data = self._unit.serializeFMUState(state)
        self._unit.freeFMUState(state)
        return msgpack.packb([self._n_steps, data]) or b""

    def restore_state(self, packed: bytes) -> None:
        """Let a unit that has been loaded go on from a state."""
        n_steps, data = msgpack.unpackb(packed)
        if n_steps == 0:
            return
        self._enter_initialization()
        self._unit.exitInitializationMode()
        state = self._unit.deserializeFMUState(data)
        self._unit.setFMUState(state)
        self._unit.freeFMUState(state)
        self._n_steps = n_steps

    def end(self) -> None:
        """Terminate the unit and free it."""
        if self._n_steps:
            self._unit.terminate()
        if self._is_instantiated:
            free = self._unit.fmi3FreeInstance if self._version == 3 else self._unit.fmi2FreeInstance
            free(self._unit.component)

    def _load(self, plan: Mapping[str, Any], folder: Path) -> Any:
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        types = {2: FMU2Slave, 3: FMU3Slave}
        self._marker.enter("the loading of its binary")
        try:
            return types[self._version](
                guid=plan["token"],
                modelIdentifier=plan["identifier"],
                unzipDirectory=str(folder),
                instanceName=plan["name"],
            )
        except AttributeError as error:
            raise FmuError(
                f"expected a binary with all functions of FMI {self._version}, was one without: {error}"
            ) from None
        except Exception as error:
            raise FmuError(f"expected a binary that can be loaded, could not: {_shorten(error)}") from None
        finally:
            self._marker.leave()

    def _instantiate(self, categories: Sequence[str]) -> None:
        kinds = [name for name in categories if not name or any(word in name.lower() for word in _FAULT_CATEGORIES)]
        try:
            if self._version == 3:
                self._unit.instantiate(loggingOn=True, logMessage=self._log_message)
            else:
                self._unit.instantiate(loggingOn=True, callbacks=self._build_callbacks())
        except FmuError:
            raise
        except Exception:
            function = "fmi3InstantiateCoSimulation" if self._version == 3 else "fmi2Instantiate"
            raise FmuError(
                f"{function}: expected an instance, was none, as where the token of the binary is not that of its "
                "description"
            ) from None
        self._is_instantiated = True
        # All else that a unit could log at each step costs time.
        if kinds:
            self._unit.setDebugLogging(loggingOn=True, categories=kinds)

    def _build_callbacks(self) -> Any:
        from ctypes import byref

        from fmpy import calloc, fmi2, free
        from fmpy.logging import addLoggerProxy

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(
            lambda component, name, status, category, message: self._log_message(component, status, category, message)
        )
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(byref(callbacks))
        return callbacks

    # Called by the unit from within its functions.
    def _log_message(self, _component: Any, status: int, category: bytes | None, message: bytes | None) -> None:
        del category
        text = " ".join((message or b"").decode(errors="replace").split())[:_MAX_LINE_LENGTH]
        self._n_logged += 1
        if self._n_logged <= _MAX_LOGGED:
            sys.stderr.write(f"[{_name_status(status)}] {text}\n")
            sys.stderr.flush()
        if status:
            self._log.append(text)

    def _call(self, function: str, *arguments: Any) -> Any:
        from fmpy.fmi1 import FMICallException

        self._marker.enter(function)
        try:
            return self._call_directly(function, *arguments)
        except FMICallException as error:
            if function == "fmi2DoStep" and error.status == _DISCARD:
                raise FmuError(self._describe_discard()) from None
            expected = f"{function}: expected status OK or Warning{self._describe_time()}"
            raise FmuError(f"{expected}, was {_name_status(error.status)}") from None
        finally:
            self._marker.leave()

    def _enter_initialization(self) -> None:
        if self._version == 2:
            self._unit.setupExperiment(startTime=0.0)
            self._unit.enterInitializationMode()
        else:
            self._unit.enterInitializationMode(startTime=0.0)

    def _do_steps(self) -> None:
        n_before = (self._n_steps - 1) * self._n_substeps
        for i in range(n_before, n_before + self._n_substeps):
            # Times are computed and never added up.
            start_s, end_s = i * self._step_ns / 1e9, (i + 1) * self._step_ns / 1e9
            if self._version == 2:
                self._unit.doStep(start_s, self._step_ns / 1e9)
                continue
            _, wants_end, is_early, reached_s = self._unit.doStep(start_s, self._step_ns / 1e9)
            if wants_end:
                raise FmuError(f"fmi3DoStep: expected a step to {end_s:g} s, the unit asked to end the simulation")
            if is_early or reached_s < end_s - _TIME_TOLERANCE * self._step_ns / 1e9:
                raise FmuError(f"fmi3DoStep: expected a step to {end_s:g} s, it returned early at {reached_s:g} s")

    def _describe_discard(self) -> str:
        from fmpy.fmi2 import fmi2LastSuccessfulTime

        text = f"fmi2DoStep: expected a step{self._describe_time()}, was Discard"
        try:
            return f"{text}; it got to {self._unit.getRealStatus(fmi2LastSuccessfulTime):g} s"
        except FmuError:
            return text

    def _describe_time(self) -> str:
        if not self._n_steps:
            return ""
        return f" at {self._n_steps * self._n_substeps * self._step_ns / 1e9:g} s"

    def _set(self, groups: "Mapping[str, _Group]", values: Sequence[Any]) -> None:
        for kind, (references, places) in groups.items():
            chosen = [(ref, values[i]) for ref, i in zip(references, places, strict=True) if values[i] is not None]
            if chosen:
                getattr(self._unit, f"set{kind}")([ref for ref, _ in chosen], [value for _, value in chosen])

    def _get(self) -> list[Any]:
        found: list[Any] = [None] * self._n_outputs
        for kind, (references, places) in self._outputs.items():
            values = getattr(self._unit, f"get{kind}")(references)
            for i, value in zip(places, values, strict=True):
                found[i] = bool(value) if kind == "Boolean" else value
        return found


def _group(variables: Sequence[tuple[int, str]]) -> dict[str, _Group]:
    groups: dict[str, _Group] = {}
    for i, (reference, kind) in enumerate(variables):
        references, places = groups.setdefault(kind, ([], []))
        references.append(reference)
        places.append(i)
    return groups


def _name_status(status: int) -> str:
    return STATUSES[status] if 0 <= status < len(STATUSES) else f"status {status}, which FMI does not have"


def _shorten(error: Exception) -> str:
    return " ".join(str(error).split())[:_MAX_LINE_LENGTH].rstrip(".")


def _answer_requests(requests: BinaryIO, answers: BinaryIO, source: str, marker: CallMarker) -> None:
    folder = Path(tempfile.mkdtemp(prefix="unit-"))
    unit: LoadedFmu | None = None
    log: deque[str] = deque(maxlen=_MAX_LOG_LINES)
    state = b""

    def begin(request: Mapping[str, Any]) -> dict[str, Any]:
        nonlocal unit
        from fmpy import extract

        begins = tuple(request["folders"])
        try:
            extract(source, str(folder), include=lambda name: name.startswith(begins))
        except Exception as error:  # broken bytes, a name that no file can have, a full disk
            raise FmuError(f"expected an archive that can be unpacked, could not: {_shorten(error)}") from None
        unit = LoadedFmu(request, folder, marker, log)
        return {}

    def step(request: Mapping[str, Any]) -> dict[str, Any]:
        assert unit is not None
        return {"values": unit.step(request["values"])}

    def save(_: Mapping[str, Any]) -> dict[str, Any]:
        nonlocal state
        assert unit is not None
        state = unit.save_state()
        return {"n_bytes": len(state)}

    def read(request: Mapping[str, Any]) -> dict[str, Any]:
        return {"data": state[request["start"] : request["end"]]}

    def restore(request: Mapping[str, Any]) -> dict[str, Any]:
        assert unit is not None
        unit.restore_state(request["data"])
        return {}

    def end(_: Mapping[str, Any]) -> dict[str, Any]:
        nonlocal unit
        ending, unit = unit, None
        if ending is not None:
            ending.end()
        return {}

    handlers: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
        "FmuBegin": begin, "FmuStep": step, "FmuEnd": end,
        "FmuSave": save, "FmuRead": read, "FmuRestore": restore,
    }  # fmt: skip
    try:
        while (frame := read_frame(requests)) is not None:
            request: dict[str, Any] = msgpack.unpackb(frame)
            if request["message"] not in handlers:
                break
            try:
                answer = handlers[request["message"]](request)
            except FmuError as error:
                answer = {"fault": f"{error}.{' It logged: ' if log else ''}{'; '.join(log)}"}
            except Exception as error:  # what the unit returns need not be what fmpy or msgpack can take
                found = f"{type(error).__name__}: {_shorten(error)}"
                answer = {"fault": f"expected {request['message']} to be done, was {found}."}
            _write_frame(answers, answer)
    except BrokenPipeError:
        pass  # its core has ended it for a fault
    finally:
        remove_tree(folder, ignore_errors=True)


def _write_frame(stream: BinaryIO, fields: Mapping[str, Any]) -> None:
    stream.write(prefix_length(msgpack.packb(fields) or b""))
    stream.flush()


def main() -> None:
    """Serve the requests of a core until it ends."""
    source, descriptor = sys.argv[1:]
    # Whatever prints must not be taken for an answer, nor read a request.
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    import fmpy.fmi2
    import fmpy.fmi3  # noqa: F401 - before the hello, since it takes a second

    _write_frame(answers, {"tick": 0})
    _answer_requests(requests, answers, source, CallMarker(int(descriptor)))


if __name__ == "__main__":
    main()
