# pyright: reportAttributeAccessIssue=false
"""MuJoCo scene: the model of an environment with its doors and the bodies of vehicles, and its state in snapshots."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np

from gslcosim.base.errors import VehicleError
from gslcosim.base.quantities import GRAVITY_M_S2
from gslcosim.environment.model import Box, Environment
from gslcosim.environment.openings import solid_boxes
from gslcosim.environment.variants import DynamicEnvironment, find_door_boxes
from gslcosim.runtime.replay.object_state import register_external_type
from gslcosim.vehicles import Vehicle

# Masses, lengths and places of MJCF and catalogue are equal but for rounding; a radius may be a round number.
_TOLERANCE = 1e-6
_REACH_TOLERANCE = 0.05

# The part of a vehicle on wheels that must touch nothing; a site and a sensor of touch have its name.
HULL = "hull"
# Parts that a vehicle stands and drives on.
_ROLLING_PARTS = ("wheel_left", "wheel_right", "caster")
# Free bodies and wheels with contacts are all there is: the rest of the pipeline is switched off. Autoreset would hide
# a state that exploded.
_DISABLED_FEATURES = (
    mujoco.mjtDisableBit.mjDSBL_EQUALITY
    | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    | mujoco.mjtDisableBit.mjDSBL_LIMIT
    | mujoco.mjtDisableBit.mjDSBL_SPRING
    | mujoco.mjtDisableBit.mjDSBL_DAMPER
    | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    | mujoco.mjtDisableBit.mjDSBL_SENSOR
    | mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    | mujoco.mjtDisableBit.mjDSBL_ISLAND
)
# All that integration depends on: time, positions, velocities, forces that are applied, and where the solver starts.
_MUJOCO_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
# Values of the previous step that our own control reads.
_SAVED_ARRAYS = ("qacc", "qfrc_constraint", "sensordata")


def load_body_spec(vehicle: Vehicle) -> mujoco.MjSpec:
    """Return a fresh MJCF specification with the one body of a vehicle, named `body`."""
    check_body(vehicle)
    return mujoco.MjSpec.from_file(str(vehicle.mjcf_path))


# Once in a process: a suite runs the same vehicle thousands of times.
@cache
def check_body(vehicle: Vehicle) -> None:
    """Compile the MJCF of a vehicle by itself and compare it with the catalogue."""
    try:
        model = mujoco.MjSpec.from_file(str(vehicle.mjcf_path)).compile()
    except ValueError as error:
        raise VehicleError(
            f"vehicle {vehicle.name}: expected an MJCF that MuJoCo compiles, got: {error}\nFile: {vehicle.mjcf_path}"
        ) from error
    problems = [*_missing_parts(vehicle, model)] or [*_find_differences(vehicle, model)]
    if problems:
        lines = [f"vehicle {vehicle.name}: {problem}" for problem in problems]
        raise VehicleError("\n".join([*lines, f"File: {vehicle.mjcf_path}"]))


def half_height_m(model: mujoco.MjModel, root: int) -> float:
    """Return the height of a vehicle's centre above its lowest point [m].

    Parts of a vehicle are not turned against its body at the start; each hangs on the body itself.

    Args:
        root: Index of the vehicle's body in it.
    """
    geoms = [i for i in range(model.ngeom) if model.body_rootid[model.geom_bodyid[i]] == root]
    return max(_depth_m(model, i, root) for i in geoms)


# geom_aabb is centre and half size in the geom's frame.
def _depth_m(model: mujoco.MjModel, geom: int, root: int) -> float:
    body = int(model.geom_bodyid[geom])
    height_m = float(model.geom_pos[geom][2] + model.geom_aabb[geom][2])
    if body != root:
        height_m += float(model.body_pos[body][2])
    return float(model.geom_aabb[geom][5]) - height_m


def _missing_parts(vehicle: Vehicle, model: mujoco.MjModel) -> Iterator[str]:
    parts = {"body": ["body"], "joint": ["free"], "geom": ["hull"]}
    if vehicle.rotors is not None:
        parts["site"] = [f"rotor_{i}" for i in range(vehicle.rotors.n_rotors)]
    if vehicle.wheels is not None:
        wheels = ["wheel_left", "wheel_right"]
        parts["body"] += [*wheels, "caster"]
        parts["joint"] += wheels
        parts["geom"] += [*wheels, "caster"]
        parts["site"] = ["hull"]
    for kind, names in parts.items():
        number = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        for name in names:
            if mujoco.mj_name2id(model, number, name) < 0:
                yield f"expected a {kind} named {name}, found none."


def _find_differences(vehicle: Vehicle, model: mujoco.MjModel) -> Iterator[str]:
    body, root = vehicle.body, model.body("body").id
    across_m = _geom_reach_m(model, root)
    reach_m = vehicle.rotors.reach_m if vehicle.rotors else across_m
    yield from _number_difference("body.mass_kg", body.mass_kg, model.body_subtreemass[root])
    yield from _number_difference("body.half_height_m", body.half_height_m, half_height_m(model, root))
    yield from _number_difference("body.radius_m", body.radius_m, reach_m, within=_REACH_TOLERANCE)
    if across_m > body.radius_m * (1.0 + _REACH_TOLERANCE):
        yield from _number_difference("body.radius_m", body.radius_m, across_m)
    if vehicle.rotors is not None:
        for i, place_m in enumerate(vehicle.rotors.rotor_places_m):
            yield from _position_differences(f"rotors.rotor_places_m[{i}]", place_m, model.site(f"rotor_{i}").pos)
    if vehicle.wheels is not None:
        yield from _find_wheel_differences(vehicle, model)


def _find_wheel_differences(vehicle: Vehicle, model: mujoco.MjModel) -> Iterator[str]:
    wheels = vehicle.wheels
    assert wheels is not None
    for side, name in ((1.0, "wheel_left"), (-1.0, "wheel_right")):
        what = f"the place of {name}, from half_track_m and axle_height_m"
        place_m = (0.0, side * wheels.half_track_m, wheels.axle_height_m)
        yield from _position_differences(what, place_m, model.body(name).pos)
        yield from _number_difference("wheels.wheel_radius_m", wheels.wheel_radius_m, model.geom(name).size[0])
    yield from _position_differences("wheels.caster_place_m", wheels.caster_place_m, model.body("caster").pos)
    yield from _number_difference("wheels.caster_radius_m", wheels.caster_radius_m, model.geom("caster").size[0])


# The farthest that the boxes around the geoms reach along the body's x and y axes, [m].
def _geom_reach_m(model: mujoco.MjModel, root: int) -> float:
    reaches_m = [
        abs(float(model.geom_pos[i][axis] + model.geom_aabb[i][axis])) + float(model.geom_aabb[i][3 + axis])
        for i in range(model.ngeom)
        if model.geom_bodyid[i] == root
        for axis in range(2)
    ]
    return max(reaches_m)


def _number_difference(what: str, declared: float, compiled: float, *, within: float = _TOLERANCE) -> Iterator[str]:
    if not math.isclose(declared, float(compiled), rel_tol=within):
        yield f"{what}: expected {float(compiled):g}, as the MJCF has it, was {declared:g}."


def _position_differences(what: str, declared: tuple[float, float, float], compiled: Any) -> Iterator[str]:
    if any(abs(a - float(b)) > _TOLERANCE for a, b in zip(declared, compiled, strict=True)):
        shown = ", ".join(f"{float(b):g}" for b in compiled)
        yield f"{what}: expected [{shown}], as the MJCF has it, was [{', '.join(f'{a:g}' for a in declared)}]."


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A compiled scene.

    `thing_of_geom` names the object of each geom: the box, or the agent of the vehicle; `agent_of_geom` is the index
    of that agent, -1 for boxes; `is_rolling` marks wheels and casters. Parts of a vehicle are named `<agent>/<part>`.
    `half_height_m` is the height of each vehicle's centre above its lowest point.
    """

    model: mujoco.MjModel
    thing_of_geom: tuple[str, ...]
    agent_of_geom: tuple[int, ...]
    is_rolling: tuple[bool, ...]
    half_height_m: tuple[float, ...]


def build_scene(environment: Environment, vehicles: Sequence[tuple[str, Vehicle]], dt_s: float) -> Scene:
    """Return the scene of a room and its vehicles; all vehicles stand at the origin until they are placed.

    Args:
        environment: The room; each of its boxes becomes a solid geom of the same name, and so do doors that are open.
        vehicles: Agent's name and vehicle model, in the order of the state vectors.
        dt_s: Length of a physics step [s].
    """
    spec, kept = scene_spec(environment, vehicles, dt_s)
    model = spec.compile()
    del kept
    agents = [agent for agent, _ in vehicles]
    geom_names = [model.geom(i).name for i in range(model.ngeom)]
    owners = [name.split("/")[0] if "/" in name and name.split("/")[0] in agents else None for name in geom_names]
    return Scene(
        model=model,
        thing_of_geom=tuple(owner or name for owner, name in zip(owners, geom_names, strict=True)),
        agent_of_geom=tuple(-1 if owner is None else agents.index(owner) for owner in owners),
        is_rolling=tuple(name.split("/")[-1] in _ROLLING_PARTS and "/" in name for name in geom_names),
        half_height_m=tuple(half_height_m(model, model.body(f"{agent}/body").id) for agent in agents),
    )


def scene_spec(
    environment: Environment, vehicles: Sequence[tuple[str, Vehicle]], dt_s: float
) -> tuple[mujoco.MjSpec, list[mujoco.MjSpec]]:
    """Return a scene that can still be extended, and the objects that must live until it is compiled."""
    spec = mujoco.MjSpec()
    spec.modelname = environment.name
    spec.option.timestep = dt_s
    spec.option.gravity = [0.0, 0.0, -GRAVITY_M_S2]
    spec.option.disableflags = int(_DISABLED_FEATURES)
    boxes = solid_boxes(environment)
    names = {box.name for box in boxes}
    for box in (*boxes, *(door for door in find_door_boxes(environment) if door.name not in names)):
        _add_box(spec, box)
    if any(vehicle.drives for _, vehicle in vehicles):
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    kept = [load_body_spec(vehicle) for _, vehicle in vehicles]
    for (agent, vehicle), vehicle_spec in zip(vehicles, kept, strict=True):
        body = vehicle_spec.worldbody.first_body()
        spec.worldbody.add_frame(name=f"{agent}/frame").attach_body(body, f"{agent}/", "")
        if vehicle.drives:
            _add_touch(spec, f"{agent}/{HULL}")
    return spec, kept


def _add_box(spec: mujoco.MjSpec, box: Box) -> None:
    geom = spec.worldbody.add_geom(name=box.name, type=mujoco.mjtGeom.mjGEOM_BOX)
    geom.pos = [(a + b) / 2 for a, b in zip(box.min_m, box.max_m, strict=True)]
    geom.size = [(b - a) / 2 for a, b in zip(box.min_m, box.max_m, strict=True)]
    geom.rgba = list(box.rgba)


def _add_touch(spec: mujoco.MjSpec, name: str) -> None:
    spec.add_sensor(
        name=name, type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name, cutoff=0.0
    )


class DoorGeoms:
    """Opens and closes the doors of a scene with the room's; without effect in a room that has none.

    State: none of its own. MuJoCo's model follows the room with each `show`.
    """

    def __init__(self, environment: Environment, scene: Scene, room: DynamicEnvironment | None) -> None:
        """Show the doors as they are now."""
        self._model = scene.model
        self._room = room
        boxes = find_door_boxes(environment) if room is not None else ()
        self._geoms = {box.name: int(scene.model.geom(box.name).id) for box in boxes}
        self.show()

    def show(self) -> None:
        """Let closed doors collide, and open ones not."""
        if self._room is None:
            return
        closed = self._room.variant.closed
        for name, i in self._geoms.items():
            # As all boxes of the room, by MuJoCo's default.
            self._model.geom_contype[i] = self._model.geom_conaffinity[i] = int(name in closed)


def register_mujoco_state() -> None:
    """Register MuJoCo's data with snapshots, which then hold its integration state."""
    register_external_type(mujoco.MjData, read=_save_data, bring_back=_restore_data)


def _save_data(data: Any) -> dict[str, Any]:
    state = np.zeros(mujoco.mj_stateSize(data.model, _MUJOCO_STATE))
    mujoco.mj_getState(data.model, data, state, _MUJOCO_STATE)
    return {"state": state, **{name: getattr(data, name).copy() for name in _SAVED_ARRAYS}}


def _restore_data(data: Any, kept: dict[str, Any]) -> None:
    mujoco.mj_setState(data.model, data, kept["state"], _MUJOCO_STATE)
    for name in _SAVED_ARRAYS:
        getattr(data, name)[:] = kept[name]
