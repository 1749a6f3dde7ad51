"""Functions of FMI by number: how the process of a unit says, without a message, which one it is in."""

import mmap
import os
import tempfile

# One byte of memory, shared by the process of a unit and the core that waits for it: the number of a place, 0 for none.
PLACES = (
    "",
    "the loading of its binary",
    "fmi2Instantiate", "fmi2SetDebugLogging", "fmi2SetupExperiment", "fmi2EnterInitializationMode",
    "fmi2ExitInitializationMode", "fmi2DoStep", "fmi2Terminate", "fmi2FreeInstance",
    "fmi2GetReal", "fmi2GetInteger", "fmi2GetBoolean", "fmi2GetString",
    "fmi2SetReal", "fmi2SetInteger", "fmi2SetBoolean", "fmi2SetString",
    "fmi2GetFMUstate", "fmi2SetFMUstate", "fmi2FreeFMUstate", "fmi2SerializedFMUstateSize", "fmi2SerializeFMUstate",
    "fmi2DeSerializeFMUstate", "fmi2GetRealStatus",
    "fmi3InstantiateCoSimulation", "fmi3SetDebugLogging", "fmi3EnterInitializationMode", "fmi3ExitInitializationMode",
    "fmi3DoStep", "fmi3Terminate", "fmi3FreeInstance",
    *(f"fmi3{verb}{kind}" for verb in ("Get", "Set") for kind in (
        "Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean",
        "String",
    )),
    "fmi3GetFMUState", "fmi3SetFMUState", "fmi3FreeFMUState", "fmi3SerializedFMUStateSize", "fmi3SerializeFMUState",
    "fmi3DeserializeFMUState",
)  # fmt: skip
_NUMBERS = {name: i for i, name in enumerate(PLACES)}
# Numbers below it are given to pipes in a sandbox.
MIN_DESCRIPTOR = 32


class CallMarker:
    """Memory in which the process of a unit notes where it is.

    Args:
        descriptor: The file of that memory.
    """

    def __init__(self, descriptor: int) -> None:
        self._memory = mmap.mmap(descriptor, 1)

    @classmethod
    def create(cls) -> "tuple[CallMarker, int]":
        """Return new memory, and a descriptor of it for the process that is started."""
        with tempfile.TemporaryFile() as file:
            made = os.memfd_create("gslcosim") if hasattr(os, "memfd_create") else os.dup(file.fileno())
            os.ftruncate(made, 1)
            marker = cls(made)
            handed_over = _duplicate_high(made)
            os.close(made)
        return marker, handed_over

    def enter(self, place: str) -> None:
        """Note a place."""
        self._memory[0] = _NUMBERS.get(place, 0)

    def leave(self) -> None:
        """Note that it is in no function."""
        self._memory[0] = 0

    @property
    def place(self) -> str:
        """Where the process is, empty where it is in no function."""
        return PLACES[self._memory[0]]

    def close(self) -> None:
        """Give the memory back."""
        self._memory.close()


def _duplicate_high(descriptor: int) -> int:
    import fcntl  # which Windows lacks

    return fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, MIN_DESCRIPTOR)
