"""Exception tree: one class for each party that can cause a problem and has to act on it."""

from enum import IntEnum
from typing import ClassVar


class ExitCode(IntEnum):
    """Exit codes of the command line, which say who has to act."""

    SUCCESS = 0
    AGENT_FAILED = 1
    USAGE = 2
    FAULT = 3
    TIMEOUT = 4
    DIVERGENCE = 5
    INTERRUPTED = 130


class GslCosimError(Exception):
    """Base of all errors raised on purpose; its text is meant for a person."""

    exit_code: ClassVar[ExitCode] = ExitCode.FAULT


class ScenarioError(GslCosimError):
    """A scenario file is wrong; the user corrects the places listed in the message."""

    exit_code = ExitCode.USAGE


class UsageError(GslCosimError):
    """A command line is wrong; the user corrects the call."""

    exit_code = ExitCode.USAGE


class VehicleError(GslCosimError):
    """The folder of a vehicle is incomplete or contradicts itself; who made the vehicle corrects it."""

    exit_code = ExitCode.USAGE


class EnvironmentDataError(GslCosimError):
    """An environment folder or imported file is missing, corrupt or inconsistent; the user fixes the file."""

    exit_code = ExitCode.USAGE


class MachineError(GslCosimError):
    """The machine refuses something: room, permission, memory; the user makes room or chooses another place."""

    exit_code = ExitCode.FAULT


class RecordingError(GslCosimError):
    """A recording cannot be shown or repaired; the user installs what is named, or flies the run again."""

    exit_code = ExitCode.USAGE


class RecordingWriteError(MachineError, RecordingError):
    """A recording cannot be written; the user frees the disk, or does without the recording."""


class RunFolderError(MachineError):
    """A file in a run's folder cannot be written; the user frees the disk, or finds out who took the folder away."""


class FlowError(GslCosimError):
    """A wind solve cannot start or has diverged; the user changes boundary, cell or time step."""

    exit_code = ExitCode.USAGE


class ShapeError(GslCosimError, ValueError):
    """An array argument has the wrong shape or dtype; the caller's code is wrong."""


class MethodError(GslCosimError):
    """A method lacks what it needs, or its card or a parameter is wrong; the user changes the scenario or the card."""


class ContractError(GslCosimError):
    """A message is not what the contract says; the sender is wrong."""


class DataflowError(GslCosimError):
    """Declared reads and writes do not form a runnable dataflow (for example a cycle without delay)."""


class ModelError(GslCosimError):
    """A core's state became invalid (not finite, out of its range); the run is stopped."""


class SnapshotError(GslCosimError):
    """A core's state cannot be kept or brought back; the text says what of it."""


class SimulationFault(GslCosimError):  # noqa: N818 - it is somebody's fault, and the text says whose
    """A service failed during a run; names the culprit."""


class RunTimeoutError(GslCosimError):
    """Nothing moved for longer than allowed; says who waits for whom."""

    exit_code = ExitCode.TIMEOUT
