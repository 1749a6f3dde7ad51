"""Services of one host reach each other past the router: what they send takes one hop in place of two."""
# Zenoh's stubs leave many types open.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false

import contextlib
import json
import os
from collections.abc import Generator

import zenoh

from gslcosim.bus.port import INHERITED_FILES, Join

# How long a service tries to reach the router, and how soon it tries again those that have not started yet.
MESH_LIMIT_MS = 2000
MESH_RETRY = {"period_init_ms": 10, "period_max_ms": 100, "period_increase_factor": 1.5}


def is_possible() -> bool:
    """Whether this system has files without a name, the one place for accounts where agents of the same user cannot
    read them.
    """
    return hasattr(os, "memfd_create")


@contextlib.contextmanager
def joining_mesh(config: zenoh.Config, join: Join) -> Generator[None]:
    """Configure a session as a peer of the other services, and let it open within the block.

    A router forwards nothing between peers, so whatever one writes reaches each reader once. Peers let each other in as
    the router lets in services. Does nothing for who is in no mesh.
    """
    mesh = join.mesh
    if mesh is None:
        yield
        return
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", json.dumps([mesh.listen]))
    endpoints = [f"{join.endpoint}#exit_on_failure=true", *(f"{other}#exit_on_failure=false" for other in mesh.connect)]
    config.insert_json5("connect/endpoints", json.dumps(endpoints))
    config.insert_json5("connect/timeout_ms", str(MESH_LIMIT_MS))
    config.insert_json5("connect/retry", json.dumps(MESH_RETRY))
    accounts = os.memfd_create("accounts")
    try:
        os.write(accounts, f"{join.user}:{join.password}\n".encode())
        config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(INHERITED_FILES / str(accounts))))
        yield
    finally:
        os.close(accounts)


def is_router_lost(event: zenoh.TransportEvent) -> bool:
    """Whether the link to the router has ended; peers come and go."""
    return event.kind == zenoh.SampleKind.DELETE and event.transport.whatami == zenoh.WhatAmI.ROUTER
