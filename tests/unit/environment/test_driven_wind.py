"""A service can scale the wind of a room; without one the frames are handed out as they are."""

import numpy as np
import pytest

from gslcosim.contract.ventilation import WindShare
from gslcosim.environment.driven_wind import DrivenWind
from gslcosim.environment.model import WindFrames


@pytest.fixture
def frames():
    rng = np.random.default_rng(1)
    return WindFrames(velocity_m_s=rng.normal(size=(3, 2, 2, 2, 3)).astype(np.float32), period_s=10.0)


def test_a_share_scales_every_frame(frames):
    wind = DrivenWind(frames)
    wind.take(WindShare(tick=0, share=2.5))
    for i, time_s in enumerate((0.0, 10.0, 29.9)):
        np.testing.assert_array_equal(wind.at(time_s), frames.velocity_m_s[i] * np.float32(2.5))


def test_the_last_share_holds(frames):
    wind = DrivenWind(frames)
    for share in (0.0, 3.0, 0.5):
        wind.take(WindShare(tick=0, share=share))
        wind.take(None)
        np.testing.assert_array_equal(wind.at(5.0), frames.velocity_m_s[0] * np.float32(share))


def test_without_a_share_the_frames_are_not_copied(frames):
    wind = DrivenWind(frames)
    assert np.shares_memory(wind.at(12.0), frames.velocity_m_s[1])
    wind.take(WindShare(tick=0, share=2.0))
    wind.reset()
    assert np.shares_memory(wind.at(12.0), frames.velocity_m_s[1])


@pytest.mark.parametrize("share", [1.0, 2.0])
def test_winds_are_handed_out_read_only_and_contiguous(frames, share):
    wind = DrivenWind(frames)
    wind.take(WindShare(tick=0, share=share))
    assert wind.at(0.0).flags.c_contiguous
    assert not wind.at(0.0).flags.writeable
    assert wind.at(0.0).dtype == np.float32
