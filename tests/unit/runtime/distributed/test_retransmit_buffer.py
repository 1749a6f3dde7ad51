"""What a participant keeps of what it has sent, for readers that missed some."""

from built_messages import build_poses

from gslcosim.contract import codec
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.retransmission import RetransmitBuffer
from gslcosim.runtime.stepper import SentMessage


def answers(kept, tick):
    return kept.answer(protocol.ResendRequest(port="truth/bodies", tick=tick).to_bytes())


def test_messages_of_a_rare_port_are_forgotten_as_early_as_those_of_any_other():
    kept = RetransmitBuffer(n_ticks=100)
    for tick in range(0, 1000, 10):
        message = build_poses(tick)
        kept.keep(SentMessage("truth/bodies", message, codec.encode(message)))
    assert answers(kept, 890) == []
    assert len(answers(kept, 900)) == 10
    assert len(answers(kept, 990)) == 1
    assert answers(kept, 895) == []
