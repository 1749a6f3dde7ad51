"""Paths to single values in messages: what they find, and what is said of those that find nothing."""

import pytest
from built_messages import build_sample

from gslcosim.base.errors import UsageError
from gslcosim.contract.messages import BodyPoses, FieldSamples, Observation
from gslcosim.contract.participant_messages import ParticipantValues
from gslcosim_fmi.value_path import parse_value_path

SAMPLES = FieldSamples(
    tick=7,
    samples=tuple(
        build_sample(sensor=sensor, wind_m_s=(0.5, 0.0, -0.25), ethanol=ppm)
        for sensor, ppm in (("nose", 3.5), ("tail", 1.5))
    ),
)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("tick", 7),
        ("samples[1].gases[0].mixing_ratio_ppm", 1.5),
        ("samples[agent=beetle, sensor=tail].gases[gas=ethanol].mixing_ratio_ppm", 1.5),
        ("samples[-2].wind_world_m_s[2]", -0.25),
        ("samples[0].sensor", "nose"),
        ("samples[2].sensor", None),
        ("samples[sensor=ear].sensor", None),
        ("samples[0].gases[gas=methane].mixing_ratio_ppm", None),
        ("samples[0].beam_m", None),
    ],
)
def test_a_path_finds_its_value_or_nothing(path, expected):
    assert parse_value_path(path, FieldSamples).read(SAMPLES) == expected


def test_values_by_name_are_found_in_the_messages_of_participants():
    path = parse_value_path("values.level", ParticipantValues)
    assert path.read(ParticipantValues(tick=0, values={"level": 2.0})) == 2.0
    assert path.read(ParticipantValues(tick=0, values={})) is None
    assert path.field == "level"


@pytest.mark.parametrize(
    ("message_type", "path", "expected"),
    [
        (FieldSamples, "sample[0]", "expected one of samples, tick, was 'sample'. Did you mean samples?"),
        (FieldSamples, "samples", "which needs one of its items, such as [0], was 'samples'"),
        (FieldSamples, "samples[0].gases.gas", "expected an item of the list before it, such as [0], was 'gas'"),
        (FieldSamples, "samples[0]", "which needs one of its fields (agent, beam_m, gases, sensor, wind_world_m_s)"),
        (FieldSamples, "samples[name=x].sensor", "expected [agent=…] with a field of its items (agent, beam_m, gases"),
        (FieldSamples, "tick[0]", "expected no [] behind tick, which is no list, was some"),
        (FieldSamples, "samples[0]..gas", "expected fields such as bodies[agent=beetle].position_world_m[0], was ''"),
        (BodyPoses, "bodies[0].inertial_body", "expected a number, a truth value or a text"),
        (Observation, "readings[sensor=nose].value", "was 'value'. Did you mean values?"),
    ],
)
def test_a_path_to_nothing_is_refused_with_what_there_is(message_type, path, expected):
    with pytest.raises(UsageError) as caught:
        parse_value_path(path, message_type)
    assert expected in str(caught.value)
