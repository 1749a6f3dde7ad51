"""The agent that sees: it looks around, believes in what is blue, and searches as a source map does without."""

import io
import math

import numpy as np
import pytest
from briefings import briefing, observation
from PIL import Image

from gslcosim.contract.messages import CameraImage, Reading
from gslcosim_agents.vision_prior.agent import VisionPrior
from gslcosim_search.beliefs import CellGrid

SENSORS = (("pid", "nose"), ("anemometer", "vane"), ("camera", "eye"))
HERE_M = (3.0, 5.0, 1.2)
GREY, BLUE, ORANGE = (115, 115, 120), (41, 69, 140), (158, 117, 77)


def image(colour, tick):
    """A level picture, 60 degrees high, of a wall of that colour whose foot is 2.4 m ahead of a camera 1.2 m high."""
    pixels = np.tile(np.array(GREY, np.uint8), (64, 64, 1))
    focal_px = 32 / math.tan(math.pi / 6)
    foot_px = 32 + round(0.5 * focal_px)
    pixels[20:foot_px, 28:36] = colour
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return CameraImage(
        encoding="png", width_px=64, height_px=64, focal_px=focal_px, centre_px=(32.0, 32.0),
        position_body_m=(0.0, 0.0, 0.0), quaternion_body_wxyz=(0.5, -0.5, 0.5, -0.5), taken_tick=tick,
        data=file.getvalue(),
    )  # fmt: skip


def seen(tick, *, colour=None, yaw_rad=0.0, ppm=0.0, taken=None, velocity_m_s=(0.0, 0.0, 0.0), position_m=HERE_M):
    made = observation(
        tick=tick, position_m=position_m, readings={"nose": ppm, "vane": (0.5, math.pi)}, yaw_rad=yaw_rad,
        velocity_m_s=velocity_m_s,
    )  # fmt: skip
    picture = None if colour is None else image(colour, tick if taken is None else taken)
    return made.model_copy(
        update={
            "readings": (*made.readings, Reading(sensor="eye", quantity="picture", unit="1", values=(), image=picture))
        }
    )


def agent(**parameters):
    return VisionPrior(briefing(sensors=SENSORS, search_height_m=1.2, parameters=parameters))


def belief_at(command, place_m):
    belief = command.belief
    grid = CellGrid(belief.origin_m[:2], belief.cell_m, belief.probability.shape)
    return float(belief.probability.to_array()[grid.cell_at(place_m)])


def test_it_looks_into_all_directions_first():
    seer = agent(looks=4)
    commands = [seer.decide(seen(10 * i)) for i in range(1, 6)]
    assert [command.kind for command in commands] == ["hold"] * 4 + ["waypoint"]
    assert [command.yaw_rad for command in commands[:4]] == pytest.approx([0.0, math.pi / 2, math.pi, -math.pi / 2])
    assert commands[4].faces_path


@pytest.mark.parametrize("yaw_rad", [0.0, math.pi / 2, -2.0])
def test_what_it_sees_is_believed_where_it_stands(yaw_rad):
    seer = agent(looks=0)
    command = seer.decide(seen(10, colour=BLUE, yaw_rad=yaw_rad))
    place_m = (HERE_M[0] + 2.4 * math.cos(yaw_rad), HERE_M[1] + 2.4 * math.sin(yaw_rad))
    assert belief_at(command, place_m) > 10.0 * belief_at(command, (12.0, 9.0))


def test_a_late_picture_is_seen_from_where_it_was_taken():
    seer = agent(looks=0)
    seer.observe(seen(10, yaw_rad=0.0))
    seer.observe(seen(20, colour=BLUE, yaw_rad=math.pi / 2, taken=10))
    assert seer.seen.things[0].centre_m == pytest.approx((5.4, 5.0), abs=0.1)


def test_pictures_in_flight_without_a_pose_or_from_before_are_not_used():
    seer = agent(looks=0)
    seer.observe(seen(10, colour=BLUE, velocity_m_s=(1.0, 0.0, 0.0)))
    seer.observe(seen(500, colour=BLUE, taken=450))
    assert seer.seen.things == ()
    seer.observe(seen(510, colour=BLUE))
    seer.observe(seen(520, colour=ORANGE, taken=505))
    assert [thing.label for thing in seer.seen.things] == ["blue"]


def test_gas_decides_between_two_things_that_look_alike():
    """Blue things upwind and downwind of a whiff: only the one upwind can have released it."""
    seer = agent(looks=0)
    seer.observe(seen(10, colour=BLUE, position_m=(4.0, 5.0, 1.2)))
    seer.observe(seen(20, colour=BLUE, position_m=(9.0, 5.0, 1.2)))
    for tick in range(30, 130):
        seer.observe(seen(tick, ppm=2.0, position_m=(9.0, 5.0, 1.2)))
    command = seer.decide(seen(130, ppm=2.0, position_m=(9.0, 5.0, 1.2)))
    upwind, downwind = (belief_at(command, place_m) for place_m in ((6.4, 5.0), (11.4, 5.0)))
    assert upwind > 2.0 * downwind
