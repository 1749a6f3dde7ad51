"""A dataflow that cannot run is refused before anything starts, by name."""

from pathlib import Path

import pytest
from toy_cores import COMMAND, toy_cores, toy_dataflow

from gslcosim.base.errors import DataflowError
from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, Score
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.runtime.dataflow import Dataflow


def spec(name, reads=(), writes=()):
    return ParticipantSpec(name=name, reads=tuple(reads), writes=tuple(writes))


def test_a_cycle_without_delay_is_refused_with_its_path():
    a = spec("a", [Read(port="y")], [Write(port="x", message_type=BodyPoses)])
    b = spec("b", [Read(port="x")], [Write(port="y", message_type=Score)])
    with pytest.raises(DataflowError, match=r"a → b → a|b → a → b"):
        Dataflow((a, b))


def test_a_cycle_with_a_delay_is_accepted():
    a = spec("a", [Read(port="y", delay_ticks=1)], [Write(port="x", message_type=BodyPoses)])
    b = spec("b", [Read(port="x")], [Write(port="y", message_type=Score)])
    assert Dataflow((a, b)).order == ("a", "b")


def test_reading_its_own_output_needs_a_delay():
    with pytest.raises(DataflowError, match="its own x"):
        Dataflow((spec("a", [Read(port="x")], [Write(port="x", message_type=BodyPoses)]),))


def test_a_port_has_exactly_one_writer():
    write = Write(port="x", message_type=BodyPoses)
    with pytest.raises(DataflowError, match="expected one writer, found a and b"):
        Dataflow((spec("a", writes=[write]), spec("b", writes=[write])))
    with pytest.raises(DataflowError, match="a reads nowhere: expected a writer"):
        Dataflow((spec("a", [Read(port="nowhere")]),))


def test_an_announced_port_needs_its_announcement():
    cores = toy_cores()
    blind = spec("blind", [Read(port=COMMAND)])
    late = spec("late", [Read(port=COMMAND), Read(port=keys.BODIES, delay_ticks=1)])
    for extra in (blind, late):
        with pytest.raises(DataflowError, match="expected it to read truth/bodies too"):
            Dataflow((*(core.spec for core in cores.values()), extra))


def test_the_graph_of_a_run_is_as_recorded():
    golden = Path(__file__).parents[2] / "golden" / "toy_dataflow.txt"
    assert toy_dataflow().describe() == golden.read_text()
