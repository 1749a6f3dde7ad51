"""The sensing service of gslcosim in a process that stops itself before it joins."""

import os
import signal
from dataclasses import replace
from pathlib import Path

from gslcosim.runtime.services import default_services, get_block_service
from gslcosim.scenario.models.participants import ServiceSpec


class SensingBlock(ServiceSpec):
    """Sensing that never joins."""

    name: str = "sensing"


@get_block_service.register
def _halting(settings: SensingBlock):
    usual = next(kind for kind in default_services() if kind.name == settings.name)

    def build(setup):
        # Others build it to see what it writes.
        if b"gslcosim_services\0sensing" in Path("/proc/self/cmdline").read_bytes():
            os.kill(os.getpid(), signal.SIGSTOP)
        return usual.build(setup)

    return replace(usual, build=build)
