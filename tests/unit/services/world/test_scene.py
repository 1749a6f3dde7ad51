import dataclasses

import mujoco
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.vehicles import get_vehicle
from gslcosim_services.world.scene import build_scene

CRATE = ("crate", (5.0, 5.0, 0.0), (6.0, 6.5, 1.0))


def test_everything_is_named(make_room):
    room = make_room(obstacles=[CRATE])
    model = build_scene(room, [("beetle", get_vehicle("iris")), ("moth", get_vehicle("iris"))], 0.004).model
    for kind, n in (("body", model.nbody), ("geom", model.ngeom), ("joint", model.njnt), ("site", model.nsite)):
        names = [mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), i) for i in range(n)]
        assert all(names), kind
    assert {box.name for box in room.boxes} <= {model.geom(i).name for i in range(model.ngeom)}


def test_geoms_are_traced_to_boxes_and_agents(make_room):
    scene = build_scene(make_room(), [("beetle", get_vehicle("iris")), ("moth", get_vehicle("iris"))], 0.004)
    geom = scene.model.geom("moth/hull").id
    assert (scene.thing_of_geom[geom], scene.agent_of_geom[geom]) == ("moth", 1)
    floor = scene.model.geom("floor").id
    assert (scene.thing_of_geom[floor], scene.agent_of_geom[floor]) == ("floor", -1)


def test_a_room_without_a_floor_gets_one(make_room):
    room = make_room()
    bare = dataclasses.replace(room, boxes=tuple(box for box in room.boxes if box.kind != "floor"))
    model = build_scene(bare, [("beetle", get_vehicle("iris"))], 0.004).model
    floor = model.geom("floor")
    assert floor.pos[2] + floor.size[2] == pytest.approx(0.0)


def test_two_boxes_of_one_name_are_refused(make_room):
    with pytest.raises(EnvironmentDataError, match=r"different names, was \['crate'\]"):
        build_scene(make_room(obstacles=[CRATE, CRATE]), [("beetle", get_vehicle("iris"))], 0.004)
