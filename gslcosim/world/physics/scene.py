"""One MuJoCo model of a room and its vehicles, everything in it named."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from gslcosim.environment.doors import boxes_of_doors
from gslcosim.environment.model import Box, Environment
from gslcosim.environment.solids import solid_boxes
from gslcosim.quantities import GRAVITY_M_S2
from gslcosim.vehicles import Vehicle
from gslcosim.world.physics.vehicle_bodies import body_spec, half_height_m

# The part of a vehicle on wheels that must touch nothing; a site and a sensor of touch have its name.
HULL = "hull"
# Parts that a vehicle stands and drives on.
_ROLLING = ("wheel_left", "wheel_right", "caster")

# Free bodies and wheels with contacts are all there is: the rest of the pipeline is switched off. Autoreset would hide
# a state that exploded.
_DISABLED = (
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


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A compiled scene.

    `thing_of_geom` names for each geom what is touched: the box, or the agent whose vehicle it belongs to;
    `agent_of_geom` is the index of that agent, -1 for boxes; `is_rolling` tells wheels and casters. Parts of a vehicle
    are named `<agent>/<part>`. `half_height_m` is how far each vehicle's lowest point is below its centre.
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

    Raises:
        EnvironmentDataError: two boxes of the room have one name.
        VehicleError: the MJCF of a vehicle contradicts the catalogue.
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
        is_rolling=tuple(name.split("/")[-1] in _ROLLING and "/" in name for name in geom_names),
        half_height_m=tuple(half_height_m(model, model.body(f"{agent}/body").id) for agent in agents),
    )


def scene_spec(
    environment: Environment, vehicles: Sequence[tuple[str, Vehicle]], dt_s: float
) -> tuple[mujoco.MjSpec, list[mujoco.MjSpec]]:
    """Return a scene as it can still be added to, and what must live until it is compiled; see `build_scene`."""
    spec = mujoco.MjSpec()
    spec.modelname = environment.name
    spec.option.timestep = dt_s
    spec.option.gravity = [0.0, 0.0, -GRAVITY_M_S2]
    spec.option.disableflags = int(_DISABLED)
    boxes = solid_boxes(environment)
    names = {box.name for box in boxes}
    for box in (*boxes, *(door for door in boxes_of_doors(environment) if door.name not in names)):
        _add_box(spec, box)
    if any(vehicle.drives for _, vehicle in vehicles):
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    kept = [body_spec(vehicle) for _, vehicle in vehicles]
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
