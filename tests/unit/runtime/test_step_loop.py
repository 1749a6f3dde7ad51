"""The loop over one process: in a whole run nobody is ahead by more than a tick, or past the end."""

import pytest
from toy_cores import COMMAND, toy_cores, toy_dataflow

from gslcosim.contract.messages import Command, Observation
from gslcosim.contract.participant import Episode, get_agent_participant
from gslcosim.runtime.stepper import StepLoop

FINAL_TICK = 100


class Listener:
    """Collects the observations that await a command."""

    def __init__(self):
        self.asked = []
        self.steps = []

    def on_outputs(self, stepper, outputs):
        self.asked += [
            sent.message
            for sent in outputs
            if isinstance(sent.message, Observation) and sent.message.awaiting_command
        ]  # fmt: skip

    def before_snapshot(self, stepper):
        raise AssertionError("no snapshot was asked for")

    def after_step(self, stepper):
        self.steps.append((stepper.spec.name, stepper.gate.next_tick - 1))


def build_loop(listener, *, is_whole_run):
    cores = {name: core for name, core in toy_cores().items() if name != get_agent_participant("beetle")}
    loop = StepLoop(list(cores.values()), toy_dataflow(), listener, is_whole_run=is_whole_run)
    for stepper, outputs in loop.reset(Episode(seed=7)):
        loop.pass_on(stepper, outputs)
    return loop


def fly(loop, listener):
    """Fly to the end; answer whenever nobody can go on, as an agent that takes its time does."""
    while not loop.is_finished:
        if not loop.step():
            assert listener.asked, [stepper.look() for stepper in loop.steppers]
            for observation in listener.asked:
                command = Command(tick=observation.tick, kind="waypoint", position_world_m=(1.0, 0.0, 0.0))
                loop.deliver(COMMAND, command)
            listener.asked.clear()


def test_a_whole_run_goes_tick_by_tick_and_ends_with_the_verdict():
    """A cursor keeps the turn while an agent thinks: what steps before it does not step again first."""
    listener = Listener()
    loop = build_loop(listener, is_whole_run=True)
    fly(loop, listener)
    order = [stepper.spec.name for stepper in loop.steppers]
    assert listener.steps == [(name, tick) for tick in range(FINAL_TICK + 1) for name in order]


def test_a_group_steps_whoever_can_and_runs_ahead_of_what_waits():
    listener = Listener()
    loop = build_loop(listener, is_whole_run=False)
    assert loop.step()
    stepped = [name for name, _ in listener.steps]
    assert stepped == [stepper.spec.name for stepper in loop.steppers if stepper.gate.next_tick == 1]
    assert loop.acting.spec.name == stepped[-1]


def test_a_core_that_fails_is_the_acting_one():
    loop = build_loop(Listener(), is_whole_run=True)
    (fields,) = [stepper for stepper in loop.steppers if stepper.spec.name == "fields"]

    def fail(tick, inbox):
        raise ValueError("no gas")

    fields.core.step = fail
    with pytest.raises(ValueError, match="no gas"):
        loop.step()
    assert loop.acting is fields
