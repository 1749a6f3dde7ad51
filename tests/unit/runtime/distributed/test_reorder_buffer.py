"""However messages arrive, they pass in the order of their ticks, each once."""

from hypothesis import given
from hypothesis import strategies as st

from gslcosim.runtime.distributed.retransmission import ReorderBuffer


@given(st.permutations(range(12)), st.lists(st.integers(0, 11), max_size=12))
def test_any_order_with_repetitions_passes_in_order(order, repeated):
    in_order = ReorderBuffer()
    passed = [payload for tick in [*order, *repeated] for payload in in_order.take(tick, bytes([tick]))]
    assert passed == [bytes([tick]) for tick in range(12)]
    assert in_order.lost() is None


def test_a_gap_is_asked_for_when_it_shows_and_now_and_then():
    in_order = ReorderBuffer()
    in_order.take(0, b"0")
    asked = []
    for tick in range(2, 40):
        assert in_order.take(tick, b"later") == []
        asked.append(in_order.lost())
    assert set(asked) == {1, None}
    assert 1 < asked.count(1) < 5
    assert len(in_order.take(1, b"1")) == 39
