"""Opening sessions of Zenoh: what the machine refuses them is told as such."""
# Zenoh's stubs leave many types open.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false

import os
import re

import zenoh

from gslcosim.errors import MachineError
from gslcosim.machine import LACKING, machine_error

_EXPECTED = "a session that opens"
# How pyo3 raises what Rust does not handle; no class to be imported.
_PANIC = "PanicException"


def open_session(config: zenoh.Config) -> zenoh.Session:
    """Open a session.

    Raises:
        MachineError: the machine lacks what a session needs, such as files that may be open.
        zenoh.ZError: it cannot be opened for another reason.
    """
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        found = re.search(r"\(os error (\d+)\)", str(error))
        number = int(found[1]) if found is not None else 0
        if number in LACKING:
            raise machine_error(OSError(number, os.strerror(number)), "zenoh", _EXPECTED) from error
        raise
    except BaseException as error:
        if type(error).__name__ != _PANIC:
            raise
        raise MachineError(
            f"zenoh: expected {_EXPECTED}, was {error}. Raise the limits on open files (ulimit -n) and on processes "
            "(ulimit -u), or close programs."
        ) from error


def set_unread_limit(config: zenoh.Config, limit_ms: int) -> None:
    """Close the link of a member that has read nothing for so long [ms]."""
    config.insert_json5("transport/link/tx/queue/congestion_control/block/wait_before_close", str(limit_ms * 1000))
