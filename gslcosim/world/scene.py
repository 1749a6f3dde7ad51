"""One MuJoCo model of a room and its vehicles, everything in it named."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from gslcosim.environment.model import Box, Environment
from gslcosim.errors import EnvironmentDataError
from gslcosim.world.vehicle import VehicleModel

GRAVITY_M_S2 = 9.81

# Free bodies with contacts are all there is: the rest of the pipeline is switched off. Autoreset would hide a
# state that exploded.
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
    `agent_of_geom` is the index of that agent, -1 for boxes. Parts of a vehicle are named `<agent>/<part>`.
    """

    model: mujoco.MjModel
    thing_of_geom: tuple[str, ...]
    agent_of_geom: tuple[int, ...]
    half_height_m: tuple[float, ...]


def build_scene(environment: Environment, vehicles: Sequence[tuple[str, VehicleModel]], dt_s: float) -> Scene:
    """Return the scene of a room and its vehicles; all vehicles stand at the origin until they are placed.

    Args:
        environment: The room; each of its boxes becomes a solid geom of the same name.
        vehicles: Agent's name and vehicle model, in the order of the state vectors.
        dt_s: Length of a physics step [s].

    Raises:
        EnvironmentDataError: two boxes of the room have one name.
    """
    spec = mujoco.MjSpec()
    spec.modelname = environment.name
    spec.option.timestep = dt_s
    spec.option.gravity = [0.0, 0.0, -GRAVITY_M_S2]
    spec.option.disableflags = int(_DISABLED)
    for box in _boxes(environment):
        _add_box(spec, box)
    for agent, vehicle in vehicles:
        # The body's specification must outlive the compilation.
        body = vehicle.body_spec().worldbody.first_body()
        spec.worldbody.add_frame(name=f"{agent}/frame").attach_body(body, f"{agent}/", "")
    model = spec.compile()
    agents = [agent for agent, _ in vehicles]
    geom_names = [model.geom(i).name for i in range(model.ngeom)]
    owners = [name.split("/")[0] if "/" in name and name.split("/")[0] in agents else None for name in geom_names]
    return Scene(
        model=model,
        thing_of_geom=tuple(owner or name for owner, name in zip(owners, geom_names, strict=True)),
        agent_of_geom=tuple(-1 if owner is None else agents.index(owner) for owner in owners),
        half_height_m=tuple(_half_height_m(model, agent) for agent in agents),
    )


# A room without a floor of its own (an imported one, say) gets one, so that vehicles have something to stand on.
def _boxes(environment: Environment) -> list[Box]:
    boxes = list(environment.boxes)
    doubles = sorted(name for name, n in Counter(box.name for box in boxes).items() if n > 1)
    if doubles:
        raise EnvironmentDataError(f"environment {environment.name}: expected boxes of different names, was {doubles}.")
    if not any(box.kind == "floor" for box in boxes):
        (x0, y0, z0), (x1, y1, _) = environment.grid.origin_m, environment.grid.max_m
        boxes.append(Box(name="floor", kind="floor", min_m=(x0, y0, z0 - 0.2), max_m=(x1, y1, z0)))
    return boxes


def _add_box(spec: mujoco.MjSpec, box: Box) -> None:
    geom = spec.worldbody.add_geom(name=box.name, type=mujoco.mjtGeom.mjGEOM_BOX)
    geom.pos = [(a + b) / 2 for a, b in zip(box.min_m, box.max_m, strict=True)]
    geom.size = [(b - a) / 2 for a, b in zip(box.min_m, box.max_m, strict=True)]
    geom.rgba = list(box.rgba)


def _half_height_m(model: mujoco.MjModel, agent: str) -> float:
    body = model.body(f"{agent}/body")
    first, n_geoms = int(body.geomadr[0]), int(body.geomnum[0])
    # geom_aabb is centre and half size in the geom's frame; hulls are not turned against their body.
    return max(
        float(model.geom_aabb[i][5] - model.geom_pos[i][2] - model.geom_aabb[i][2])
        for i in range(first, first + n_geoms)
    )
