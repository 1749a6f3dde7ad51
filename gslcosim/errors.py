"""The exception tree: one class per party that can cause a problem and has to act on it."""


class GslCosimError(Exception):
    """Base of all errors raised on purpose; its text is meant for a person."""


class ScenarioError(GslCosimError):
    """A scenario file is wrong; the user corrects the places listed in the message (exit code 2)."""


class UsageError(GslCosimError):
    """A command line is wrong; the user corrects the call (exit code 2)."""


class EnvironmentDataError(GslCosimError):
    """An environment folder or imported file is missing, corrupt or inconsistent; the user fixes the file."""


class RecordingError(GslCosimError):
    """A recording cannot be written, shown, or repaired; the user frees the disk, installs what is named, or reruns."""


class FlowError(GslCosimError):
    """A wind solve cannot start or has diverged; the user changes boundary, cell or time step."""


class ShapeError(GslCosimError, ValueError):
    """An array argument has the wrong shape or dtype; the caller's code is wrong."""


class MethodError(GslCosimError):
    """A method lacks what it needs, or its card or a parameter is wrong; the user changes the scenario or the card."""


class ContractError(GslCosimError):
    """A message is not what the contract says; the sender is wrong."""


class DataflowError(GslCosimError):
    """Declared reads and writes do not form a runnable dataflow (for example a cycle without delay)."""


class ModelError(GslCosimError):
    """A core's state became invalid (not finite, out of its range); the run is stopped (exit code 3)."""


class SimulationFault(GslCosimError):  # noqa: N818 - it is somebody's fault, and the text says whose
    """A service failed during a run; names the culprit (exit code 3)."""


class RunTimeoutError(GslCosimError):
    """Nothing moved for longer than allowed; says who waits for whom (exit code 4)."""
