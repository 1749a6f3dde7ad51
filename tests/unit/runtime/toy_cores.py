"""Small cores with the shape of a real run, for tests of the runtime."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from built_messages import build_body, build_poses

from gslcosim.contract import keys
from gslcosim.contract.messages import (
    AgentScore,
    BodyPoses,
    Command,
    FieldSamples,
    FilamentCloud,
    Message,
    MountSample,
    Observation,
    Score,
    Verdict,
)
from gslcosim.contract.participant import Episode, ParticipantSpec, Read, Write, get_agent_participant
from gslcosim.contract.record import NumericArray
from gslcosim.runtime.dataflow import Dataflow

COMMAND = keys.command("beetle")
OBSERVATION = keys.observation("beetle")


@dataclass
class ToyCore:
    spec: ParticipantSpec
    state: float = 0.0

    def reset(self, episode: Episode) -> Mapping[str, Message]:
        self.state = float(episode.seed)
        return {}


class ToyWorld(ToyCore):
    """Asks at every seventh tick and moves by what it is set to."""

    def step(self, tick: int, inbox: Mapping[str, Message]) -> Mapping[str, Message]:
        command = inbox.get(COMMAND)
        if isinstance(command, Command) and command.position_world_m:
            self.state += 0.1 * command.position_world_m[0] + tick
        body = build_body("beetle", (self.state, 0.0, 0.0), awaiting_command=tick % 7 == 3)
        return {keys.BODIES: build_poses(tick, body)}


class ToyFields(ToyCore):
    def step(self, tick: int, inbox: Mapping[str, Message]) -> Mapping[str, Message]:
        poses = inbox[keys.BODIES]
        assert isinstance(poses, BodyPoses)
        assert poses.tick == tick
        wind = (poses.bodies[0].position_world_m[0] * 1.5 + tick, 0.0, 0.0)
        sample = MountSample(agent="beetle", sensor="nose", gases=(), wind_world_m_s=wind)
        outbox: dict[str, Message] = {keys.SAMPLES: FieldSamples(tick=tick, samples=(sample,))}
        if tick % 5 == 0:
            empty = NumericArray.from_array(np.zeros((0, 3), np.float32))
            none = NumericArray.from_array(np.zeros(0, np.float32))
            index = NumericArray.from_array(np.zeros(0, np.uint8))
            outbox[keys.FILAMENTS] = FilamentCloud(
                tick=tick, gases=("ethanol",), position_world_m=empty, sigma_m=none, gas_index=index
            )
        return outbox


class ToySensing(ToyCore):
    def step(self, tick: int, inbox: Mapping[str, Message]) -> Mapping[str, Message]:
        poses, samples = inbox[keys.BODIES], inbox[keys.SAMPLES]
        assert isinstance(poses, BodyPoses)
        assert isinstance(samples, FieldSamples)
        assert poses.tick == samples.tick == tick
        return {
            OBSERVATION: Observation(
                tick=tick,
                agent="beetle",
                time_s=tick * 0.1,
                position_world_m=samples.samples[0].wind_world_m_s,
                yaw_rad=0.0,
                velocity_world_m_s=(0.0, 0.0, 0.0),
                status="flying",
                awaiting_command=poses.bodies[0].awaiting_command,
                readings=(),
            )
        }


class ToyReferee(ToyCore):
    """Ends the run at a tick it is given."""

    final_tick = 100

    def step(self, tick: int, inbox: Mapping[str, Message]) -> Mapping[str, Message]:
        poses = inbox[keys.BODIES]
        assert isinstance(poses, BodyPoses)
        assert (COMMAND in inbox) == poses.bodies[0].awaiting_command
        self.state += COMMAND in inbox
        score = AgentScore(agent="beetle", distance_to_source_m=0.0, path_length_m=0.0, n_commands=int(self.state))
        is_final = tick == self.final_tick
        outbox: dict[str, Message] = {keys.SCORE: Score(tick=tick, agents=(score,), is_final=is_final)}
        if is_final:
            outbox[keys.VERDICT] = Verdict(tick=tick, end_reason="time_limit", agents=())
        return outbox


class ToyAgent(ToyCore):
    """Stands where the validator stands in a real run: answers an observation that awaits a command."""

    def step(self, tick: int, inbox: Mapping[str, Message]) -> Mapping[str, Message]:
        observation = inbox[OBSERVATION]
        assert isinstance(observation, Observation)
        if not observation.awaiting_command:
            return {}
        self.state += observation.position_world_m[0]
        return {COMMAND: Command(tick=tick, kind="waypoint", position_world_m=(self.state % 10.0, 0.0, 0.0))}


class ToyRecorder(ToyCore):
    def step(self, tick: int, inbox: Mapping[str, Message]) -> Mapping[str, Message]:
        assert all(message.tick == tick for message in inbox.values())
        assert (keys.FILAMENTS in inbox) == (tick % 5 == 0)
        return {}


def toy_cores() -> dict[str, ToyCore]:
    """Return the cores of a run with one agent that is asked every seventh tick."""
    agent = get_agent_participant("beetle")
    recorded = (keys.BODIES, keys.SAMPLES, keys.FILAMENTS, OBSERVATION, COMMAND, keys.SCORE)
    filaments = Write(port=keys.FILAMENTS, message_type=FilamentCloud, period_ticks=5)
    command = Write(port=COMMAND, message_type=Command, announced_in=keys.BODIES)
    verdict = Write(port=keys.VERDICT, message_type=Verdict, announced_in=keys.SCORE)
    cores = (
        build_core(ToyWorld, "world", (), (Write(port=keys.BODIES, message_type=BodyPoses),), late=(COMMAND,)),
        build_core(
            ToyFields, "fields", (keys.BODIES,), (Write(port=keys.SAMPLES, message_type=FieldSamples), filaments)
        ),
        build_core(
            ToySensing, "sensing", (keys.BODIES, keys.SAMPLES), (Write(port=OBSERVATION, message_type=Observation),)
        ),
        build_core(ToyAgent, agent, (OBSERVATION, keys.BODIES), (command,)),
        build_core(
            ToyReferee, "referee", (keys.BODIES, keys.SAMPLES, COMMAND),
            (Write(port=keys.SCORE, message_type=Score), verdict),
        ),
        build_core(ToyRecorder, "recorder", recorded, (), window_ticks=200),
    )  # fmt: skip
    return {core.spec.name: core for core in cores}


def build_core(
    kind: type[ToyCore], name: str, reads: Sequence[str], writes: Sequence[Write], late=(), **more
) -> ToyCore:
    """Return a core that reads these ports of its tick and those that are `late` a tick later."""
    of_before = (Read(port=port, delay_ticks=1) for port in late)
    own = (*of_before, *(Read(port=port) for port in reads))
    return kind(ParticipantSpec(name=name, reads=own, writes=tuple(writes), **more))


def toy_dataflow() -> Dataflow:
    return Dataflow(tuple(core.spec for core in toy_cores().values()))
