from gslcosim_training.search_env import MapImage

GREY = (120, 120, 125)


def test_a_map_shows_walls_source_and_way(make_room):
    """The room is 15 x 10 m, so 32 pixels are a metre; y points up."""
    room = make_room(obstacles=[("rack", (5.0, 2.0, 0.0), (6.0, 4.0, 3.0))])
    picture = MapImage(room, 1.0, [(12.0, 8.0, 1.0)])
    picture.move_to((1.0, 1.0, 1.0))
    picture.move_to((3.0, 1.0, 1.0))
    pixels = picture.pixels()
    assert pixels.shape == (320, 480, 3)
    assert tuple(pixels[320 - 96, 176]) == GREY, "the rack's middle"
    assert tuple(pixels[64, 384]) == (0, 158, 115), "the source"
    assert tuple(pixels[320 - 32, 64]) == (0, 114, 178), "the way"
    assert tuple(pixels[320 - 32, 96]) == (213, 94, 0), "the vehicle"
