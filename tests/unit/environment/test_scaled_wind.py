"""A service can scale the wind of a room; without one the frames are handed out as they are."""

from types import SimpleNamespace

import numpy as np
import pytest

from gslcosim.base.errors import ModelError
from gslcosim.contract.environment_messages import EVENTS, WIND, EventsBeginning, WindShare
from gslcosim.environment.model import EnvironmentVariant, WindFrames
from gslcosim.environment.variants import ScaledWind
from gslcosim.scenario.models.events import WindChangesSpec

FIRST, SECOND, THIRD = 0, 1, 2


def driven(frames, scenario=None, later=None):
    rooms = {EnvironmentVariant((), i): SimpleNamespace(wind=wind) for i, wind in (later or {}).items()}
    return ScaledWind(SimpleNamespace(wind=frames, later_rooms=rooms), scenario or events())


@pytest.fixture
def frames():
    rng = np.random.default_rng(1)
    return WindFrames(velocity_m_s=rng.normal(size=(3, 2, 2, 2, 3)).astype(np.float32), period_s=10.0)


def test_the_last_share_holds(frames):
    wind = driven(frames)
    for share in (0.0, 3.0, 0.5):
        wind.obey({WIND: WindShare(tick=0, share=share)})
        wind.obey({})
        np.testing.assert_array_equal(wind.at(5.0), frames.velocity_m_s[0] * np.float32(share))


def test_without_a_share_the_frames_are_not_copied(frames):
    wind = driven(frames)
    assert np.shares_memory(wind.at(12.0), frames.velocity_m_s[1])
    wind.obey({WIND: WindShare(tick=0, share=2.0)})
    wind.reset()
    assert np.shares_memory(wind.at(12.0), frames.velocity_m_s[1])


@pytest.mark.parametrize("share", [1.0, 2.0])
def test_winds_are_handed_out_read_only_and_contiguous(frames, share):
    wind = driven(frames)
    wind.obey({WIND: WindShare(tick=0, share=share)})
    assert wind.at(0.0).flags.c_contiguous
    assert not wind.at(0.0).flags.writeable
    assert wind.at(0.0).dtype == np.float32


def events(*blocks):
    changes = tuple(WindChangesSpec(at_s=1.0, **block) for block in blocks)
    return SimpleNamespace(events=changes, environment=SimpleNamespace(doors=()), tick_ns=100_000_000)


def begins(*places):
    return {EVENTS: EventsBeginning(tick=0, beginning=places)}


def test_an_event_brings_the_wind_that_was_made_for_it(frames):
    turned = WindFrames(velocity_m_s=frames.velocity_m_s[:1] + np.float32(1.0))
    scenario = events({"inlet_velocity_m_s": (0, 1, 0), "share": 0.5}, {"share": 2.0}, {})
    wind = driven(frames, scenario, later={FIRST: turned})
    wind.obey(begins(FIRST))
    np.testing.assert_array_equal(wind.at(12.0), turned.velocity_m_s[0] * np.float32(0.5))
    wind.obey(begins(SECOND))
    np.testing.assert_array_equal(wind.at(12.0), frames.velocity_m_s[1] * np.float32(2.0))
    wind.obey(begins(THIRD))
    assert np.shares_memory(wind.at(12.0), frames.velocity_m_s[1])


def test_a_service_scales_what_an_event_has_brought(frames):
    wind = driven(frames, events({"share": 0.5}))
    wind.obey(begins(FIRST) | {WIND: WindShare(tick=0, share=3.0)})
    np.testing.assert_array_equal(wind.at(0.0), frames.velocity_m_s[0] * np.float32(1.5))
    wind.reset()
    assert np.shares_memory(wind.at(0.0), frames.velocity_m_s[0])


def test_a_wind_that_was_not_made_is_reported(frames):
    with pytest.raises(ModelError, match=r"no door closed and the wind of events\[0\], found none"):
        driven(frames, events({"inlet_velocity_m_s": (0, 1, 0)}))
