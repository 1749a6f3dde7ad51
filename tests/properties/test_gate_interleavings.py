"""The order in which messages arrive, their repetition and their loss do not matter: the digest is always the same."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "runtime"))

from toy_cores import toy_cores, toy_dataflow

from gslcosim.contract.messages import Message, Verdict
from gslcosim.contract.participant import Episode
from gslcosim.runtime.digest import RunDigest
from gslcosim.runtime.stepper import Stepper

N_INTERLEAVINGS = 1000
FINAL_TICK = 12


class Network:
    """Delivers messages in a random order, some twice, some only when asked for again."""

    def __init__(self, seed: int, *, loss_frac: float = 0.0, repeat_frac: float = 0.0) -> None:
        self.rng = np.random.default_rng(seed)
        self.loss_frac, self.repeat_frac = loss_frac, repeat_frac
        self.dataflow = toy_dataflow()
        cores = toy_cores()
        cores["referee"].final_tick = FINAL_TICK  # type: ignore[attr-defined]
        self.steppers = {name: Stepper(core, self.dataflow) for name, core in cores.items()}
        self.flying: list[tuple[str, str, Message]] = []
        self.kept: dict[tuple[str, int], Message] = {}
        self.order: list[str] = []
        for stepper in self.steppers.values():
            stepper.reset(Episode(seed=7))

    def run(self) -> RunDigest:
        names = list(self.steppers)
        while not all(stepper.gate.is_finished for stepper in self.steppers.values()):
            ready = [name for name in names if self.steppers[name].gate.can_step()]
            pick = int(self.rng.integers(len(ready) + len(self.flying))) if ready or self.flying else -1
            if pick < 0:
                self.ask_again()
            elif pick < len(ready):
                self.step(ready[pick])
            else:
                self.arrive(pick - len(ready))
        trails = {p: t.until(FINAL_TICK) for s in self.steppers.values() for p, t in s.trails.items()}
        return RunDigest(FINAL_TICK, {port: self.dataflow.writer_of[port] for port in trails}, trails)

    def step(self, name: str) -> None:
        stepper = self.steppers[name]
        self.order.append(f"{name}@{stepper.gate.next_tick}")
        for sent in stepper.step():
            self.kept[sent.port, sent.message.tick] = sent.message
            for reader in self.steppers.values():
                if any(read.port == sent.port for read in reader.spec.reads) and self.rng.random() >= self.loss_frac:
                    self.flying.append((reader.spec.name, sent.port, sent.message))
            if isinstance(sent.message, Verdict):
                for other in self.steppers.values():
                    other.gate.final_tick = sent.message.tick
        for writer in self.steppers.values():
            writer.gate.grant(name, stepper.gate.next_tick - 1)

    def arrive(self, index: int) -> None:
        name, port, message = self.flying[index]
        if self.rng.random() >= self.repeat_frac:
            self.flying.pop(index)
        self.steppers[name].gate.deliver(port, message)

    def ask_again(self) -> None:
        asked = False
        for name, stepper in self.steppers.items():
            for missing in stepper.gate.missing():
                message = self.kept.get((missing.port, missing.tick))
                if message is not None:
                    self.flying.append((name, missing.port, message))
                    asked = True
        assert asked, "nothing can move and nothing can be asked for again: a deadlock"


@pytest.fixture(scope="module")
def reference() -> RunDigest:
    return Network(0).run()


@pytest.mark.slow
def test_any_interleaving_gives_the_same_digest(reference):
    orders = set()
    for seed in range(N_INTERLEAVINGS):
        network = Network(seed)
        assert network.run().hex == reference.hex, f"seed {seed}"
        orders.add(tuple(network.order))
    assert len(orders) > 0.99 * N_INTERLEAVINGS


@pytest.mark.slow
def test_lost_and_repeated_messages_change_nothing(reference):
    for seed in range(300):
        assert Network(seed, loss_frac=0.2, repeat_frac=0.2).run().hex == reference.hex, f"seed {seed}"


def test_another_seed_gives_another_digest(reference):
    """The digest depends on the episode: the law above is not empty."""
    network = Network(0)
    for stepper in network.steppers.values():
        stepper.reset(Episode(seed=8))
    assert network.run().hex != reference.hex
