"""What an onlooker sees against where things are."""

import numpy as np
import pytest

from gslcosim.base.errors import ModelError
from gslcosim_data.free_camera import FreeCamera, project_points, world_from_camera

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
RED = ("red_box", (8.0, 4.0, 2.0), (9.0, 6.0, 4.0))


def test_a_camera_looks_at_its_place_upright():
    rotation = world_from_camera((1.0, 2.0, 3.0), (4.0, 2.0, 3.0))
    np.testing.assert_allclose(rotation, np.column_stack([(0, -1, 0), (0, 0, 1), (-1, 0, 0)]), atol=1e-12)


def test_what_is_looked_at_is_in_the_middle_and_what_is_higher_is_above():
    eye_m, at_m = (1.0, 1.0, 1.0), (5.0, 3.0, 1.0)
    points_m = np.array([at_m, (5.0, 3.0, 1.5), (-3.0, -1.0, 1.0)])
    pixels, ahead_m = project_points(points_m, eye_m, at_m, 320, 240)
    np.testing.assert_allclose(pixels[0], (160, 120))
    assert pixels[1][1] < 120
    assert ahead_m[2] < 0, "behind"


@pytest.mark.debian
def test_the_vehicle_is_drawn_where_it_is(make_room, make_scenario):
    room = make_room(obstacles=[RED])
    try:
        onlooker = FreeCamera(make_scenario({}), room, [(0, 255, 0)], 160, 120)
    except ModelError as error:
        pytest.skip(str(error))
    name = make_scenario({}).agents[0].name
    eye_m, at_m = (3.0, 5.0, 3.0), (6.0, 5.0, 3.0)
    near = onlooker.picture({name: (at_m, UPRIGHT)}, eye_m, at_m)
    away = onlooker.picture({name: ((6.0, 8.0, 1.0), UPRIGHT)}, eye_m, at_m)
    onlooker.close()
    is_green = (near[..., 1] > near[..., 0] + 40) & (near[..., 1] > near[..., 2] + 40)
    y, x = np.nonzero(is_green)
    assert abs(x.mean() - 80) < 3
    assert abs(y.mean() - 60) < 6
    assert not np.array_equal(near, away)
