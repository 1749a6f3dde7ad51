"""Python agents behind the gateway: frames in, frames out, in the order of the run."""

import io

import msgpack
import pytest

from gslcosim.agent_kit import Agent, Command
from gslcosim.agent_kit.agent import answer_frames
from gslcosim.contract import codec
from gslcosim_conformance.scripted_world import ScriptedWorld, build_briefing


class Holder(Agent):
    ended = None

    def __init__(self, briefing):
        self.agent = briefing.agent

    def decide(self, observation):
        return Command(tick=observation.tick, kind="hold", hold_s=1.0)

    def end(self, reason):
        Holder.ended = reason


def frame(name, message):
    body = msgpack.packb({**message.model_dump(), "message": name})
    return len(body).to_bytes(4, "big") + body


def frames_in(data):
    while data:
        n = int.from_bytes(data[:4], "big")
        yield msgpack.unpackb(data[4 : 4 + n], use_list=False)
        data = data[4 + n :]


@pytest.fixture
def world():
    return ScriptedWorld(7)


def test_each_question_has_one_answer_and_the_stream_s_end_is_the_run_s(world):
    sent = frame("Briefing", build_briefing(7))
    sent += b"".join(frame("Observation", world.observe(tick, is_asked=tick % 2 == 0)) for tick in range(6))
    output = io.BytesIO()
    answer_frames(Holder, [build_briefing(7).agent], io.BytesIO(sent), output)
    answers = list(frames_in(output.getvalue()))
    assert [answer["tick"] for answer in answers] == [0, 2, 4]
    assert all(codec.build_message(Command, answer).kind == "hold" for answer in answers)
    assert Holder.ended == "the link to the run was lost"


def test_what_one_of_several_raises_ends_the_process(world):
    class Broken(Holder):
        def decide(self, observation):
            raise ArithmeticError("no idea")

    names = [build_briefing(7).agent, "other"]
    other = {"agent": "other"}
    sent = b"".join(
        frame("Briefing", build_briefing(7).model_copy(update=update)) for update in ({}, other)
    ) + b"".join(
        frame("Observation", world.observe(0, is_asked=True).model_copy(update=update)) for update in ({}, other)
    )
    with pytest.raises(SystemExit, match="Failed before the end of the run"):
        answer_frames(Broken, names, io.BytesIO(sent), io.BytesIO())
