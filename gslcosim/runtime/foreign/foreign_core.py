"""The core of a participant that is a program: each step sends it all inputs of the tick and waits for its answer."""

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from gslcosim.contract import codec
from gslcosim.contract.messages import Bounds
from gslcosim.contract.participant import Episode, Inbox, Outbox, ParticipantSpec
from gslcosim.contract.participation import (
    PARTICIPATION_VERSION,
    VENTILATION,
    ParticipantBriefing,
    ParticipantHello,
    ParticipantOutputs,
    PortRead,
    PortWrite,
    VehicleOfRun,
    payload_of_inputs,
)
from gslcosim.contract.ventilation import WIND, WindShare
from gslcosim.errors import ContractError, SimulationFault
from gslcosim.quantities import Vec3
from gslcosim.rng import stream
from gslcosim.runtime.foreign.declared import foreign_spec, period_ticks_of
from gslcosim.runtime.foreign.hearing import check_hello, read_hello, read_outputs
from gslcosim.runtime.foreign.program import HELLO_WITHIN_S, ForeignProgram
from gslcosim.runtime.setup import Setup
from gslcosim.scenario.models.own_models import OwnModelSpec
from gslcosim.ticks import seconds_from_ticks

OVER = "the run is over"


class ForeignCore:
    """Stands for a program among the cores of a run. State: the program, and what it has said of the wind.

    Nobody can look into a program, so a snapshot holds all inputs that it was sent: to go on, a new start of it steps
    through them. They are kept only where a run has snapshots.

    Args:
        own: The participant in the scenario.
        setup: The run.
        message_types: The name of the message on each port that it reads or writes.
    """

    def __init__(self, own: OwnModelSpec, setup: Setup, message_types: Mapping[str, str]) -> None:
        self.spec: ParticipantSpec = foreign_spec(own, setup.scenario)
        self._own = own
        self._setup = setup
        self._message_types = message_types
        self._period_ticks = period_ticks_of(own, setup.scenario)
        self._program: ForeignProgram | None = None
        self._wind: WindShare | None = None
        self._is_kept = setup.scenario.snapshots is not None or setup.snapshot is not None
        self._past: list[tuple[int, bytes]] = []
        self._answers_hash = b""

    def reset(self, episode: Episode) -> Outbox:
        """Start the program anew, hear its hello and tell it its briefing."""
        self.close()
        self._wind, self._past, self._answers_hash = None, [], b""
        program = self._program = ForeignProgram(self._own, self._setup)
        program.start()
        payload = program.hear(ParticipantHello, "its hello (ParticipantHello)", within_s=HELLO_WITHIN_S)
        try:
            hello = read_hello(payload)
            check_hello(hello, reads=(read.port for read in self._own.reads), writes=self._own.writes)
        except ContractError as error:
            raise program.fault(str(error)) from error
        program.say("ParticipantBriefing", codec.encode(self._briefing(episode)))
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Let the program step, where its period is over; the wind stays as it was in between."""
        if tick % self._period_ticks:
            return {} if self._wind is None else {WIND: WindShare(tick=tick, share=self._wind.share)}
        time_s = seconds_from_ticks(tick, self._setup.scenario.tick_ns)
        ports = (read.port for read in self._own.reads if read.port in inbox)
        inputs = payload_of_inputs(tick, time_s, {port: codec.encode(inbox[port]) for port in ports})
        return self._ask(tick, inputs)

    def state(self) -> Mapping[str, Any]:
        """Return all inputs that the program was sent, and a hash of its answers; see `Snapshots`."""
        return {"past": list(self._past), "answers_hash": self._answers_hash}

    def bring_back(self, state: Mapping[str, Any]) -> None:
        """Let the program step through its past again; see `Snapshots`.

        Raises:
            SimulationFault: it answers otherwise than in the past.
        """
        for tick, inputs in state["past"]:
            self._ask(int(tick), bytes(inputs))
        if self._answers_hash != bytes(state["answers_hash"]):
            raise self._running().fault(
                f"expected the answers of the past {len(self._past)} steps again, were others: it is not "
                "deterministic, or has changed. Repeat the run from its start, with --from-start."
            )

    def close(self) -> None:
        """Tell the program the end, and end it."""
        program, self._program = self._program, None
        if program is not None:
            program.end(OVER)

    def _running(self) -> ForeignProgram:
        if self._program is None:
            raise SimulationFault(f"{self._own.name}: expected a reset before the first step.")
        return self._program

    def _ask(self, tick: int, inputs: bytes) -> Outbox:
        program = self._running()
        what = f"an answer to the inputs of tick {tick}"
        program.check_silence(f"no answer before the inputs of tick {tick}")
        program.say("ParticipantInputs", inputs)
        payload = program.hear(ParticipantOutputs, what, within_s=self._own.answer_within_s)
        try:
            answers = read_outputs(payload, tick, self._own.writes)
        except ContractError as error:
            raise program.fault(str(error)) from error
        wind = answers.get(VENTILATION)
        self._wind = wind if isinstance(wind, WindShare) else None
        if self._is_kept:
            self._past.append((tick, inputs))
            digest = hashlib.blake2b(self._answers_hash, digest_size=16)
            for answer in answers.values():
                digest.update(codec.encode(answer))
            self._answers_hash = digest.digest()
        return {self._own.port_of(word): answer for word, answer in answers.items()}

    def _briefing(self, episode: Episode) -> ParticipantBriefing:
        scenario, own = self._setup.scenario, self._own
        grid = self._setup.environment.grid
        return ParticipantBriefing(
            tick=0,
            participant=own.name,
            contract_version=PARTICIPATION_VERSION,
            scenario=scenario.name,
            tick_ns=scenario.tick_ns,
            period_ticks=self._period_ticks,
            seed=int(stream(episode.seed, f"participant.{own.name}").integers(2**31)),
            time_limit_s=scenario.referee.stop.time_limit_s,
            bounds=Bounds(min_m=_floats(grid.origin_m), max_m=_floats(grid.max_m)),
            gases=tuple(dict.fromkeys(source.gas or scenario.gas.gas for source in scenario.gas.sources)),
            vehicles=tuple(
                VehicleOfRun(agent=agent.name, sensors=tuple(sensor.name for sensor in agent.sensors))
                for agent in scenario.agents
            ),
            reads=tuple(
                PortRead(port=read.port, delay_ticks=read.delay, message=self._message_types[read.port])
                for read in own.reads
            ),
            writes=tuple(
                PortWrite(word=word, port=own.port_of(word), message=self._message_types[own.port_of(word)])
                for word in own.writes
            ),
            parameters=own.parameters,
        )


def _floats(corner_m: Sequence[float]) -> Vec3:
    x_m, y_m, z_m = corner_m
    return (float(x_m), float(y_m), float(z_m))
