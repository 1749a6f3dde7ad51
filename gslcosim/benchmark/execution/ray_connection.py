"""How Ray is found, kept quiet and to itself, and asked whether its nodes have the same software."""

import importlib
import os
import secrets
import socket
from collections.abc import Callable
from typing import Any

from gslcosim.errors import GslCosimError, UsageError

AUTO, LOCAL = "auto", "local"
_LISTENS_S = 10.0


def ray_module(address: str) -> Any:
    """Return the module `ray`, set to be quiet, and to be heard on this machine alone where the cluster is.

    Raises:
        UsageError: it is not installed.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # What nodes say goes to standard output otherwise, in the middle of ours.
    os.environ.setdefault("RAY_DEDUP_LOGS_SKIP_REGEX", ".*")
    # Ray announces a change to come otherwise.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    if address == LOCAL:
        # Ray's way not to be heard outside of this machine; it is read when Ray is imported.
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
        # Other users of the machine stay out; Ray would leave a token in the home folder instead.
        os.environ.setdefault("RAY_AUTH_MODE", "token")
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    try:
        ray = importlib.import_module("ray")
    except ModuleNotFoundError:
        ray = None
    # A folder that happens to be called ray can be imported too.
    if not hasattr(ray, "init"):
        raise UsageError("--ray: expected Ray to be installed, was not. Install it: pip install 'gslcosim[ray]'")
    return ray


def check_address(address: str) -> None:
    """Refuse an address where nobody listens; Ray itself asks there for minutes.

    Raises:
        UsageError: nobody does, or it has no port.
    """
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_LISTENS_S).close()
    except ValueError as error:
        raise UsageError("it has no port.") from error
    except OSError as error:
        raise UsageError(f"nobody listens there ({error.strerror or error}).") from error


def question() -> Callable[[], dict[str, str]]:
    """Return what a node is asked for its software.

    Made here, so that it travels as code: a node without gslcosim can still say so.
    """

    def tell() -> dict[str, str]:
        try:
            from gslcosim.benchmark.execution.ray_worker import installed as found

            return found()
        except ImportError as error:
            return {"missing": str(error)}

    return tell


def software_text(found: dict[str, str]) -> str:
    """Return the software of a machine in words."""
    if "missing" in found:
        return f"none that can be used ({found['missing']})"
    return f"gslcosim {found['version']} with the hashes {found['software']} and, of its agents, {found['agents']}"


def brief(error: BaseException) -> str:
    """Return the lines of an error that tell its cause; Ray's own are long."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return " ".join(lines[-3:] if isinstance(error, GslCosimError) else lines[:3])[:600]
