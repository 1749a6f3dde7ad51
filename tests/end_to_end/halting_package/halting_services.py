"""Services of gslcosim that halt: sensing stops its process before it joins, fields hang in a step."""

import os
import signal
import threading
from dataclasses import replace
from pathlib import Path

from gslcosim.runtime.services import default_services, get_block_service
from gslcosim.scenario.models.participants import ServiceSpec


class SensingBlock(ServiceSpec):
    """Sensing that never joins."""

    name: str = "sensing"


class FieldsBlock(ServiceSpec):
    """Fields that never come back from the step of a tick."""

    name: str = "fields"
    hangs_at_tick: int = 20


class HangingCore:
    """Core that does what another does until a tick."""

    def __init__(self, core, hangs_at_tick):
        self._core = core
        self._hangs_at_tick = hangs_at_tick

    @property
    def spec(self):
        return self._core.spec

    def reset(self, episode):
        return self._core.reset(episode)

    def step(self, tick, inbox):
        if tick == self._hangs_at_tick:
            threading.Event().wait()
        return self._core.step(tick, inbox)


@get_block_service.register
def _hanging(settings: FieldsBlock):
    usual = next(kind for kind in default_services() if kind.name == settings.name)
    return replace(usual, build=lambda setup: HangingCore(usual.build(setup), settings.hangs_at_tick))


@get_block_service.register
def _halting(settings: SensingBlock):
    usual = next(kind for kind in default_services() if kind.name == settings.name)

    def build(setup):
        # Others build it to see what it writes.
        if b"gslcosim_services\0sensing" in Path("/proc/self/cmdline").read_bytes():
            os.kill(os.getpid(), signal.SIGSTOP)
        return usual.build(setup)

    return replace(usual, build=build)
