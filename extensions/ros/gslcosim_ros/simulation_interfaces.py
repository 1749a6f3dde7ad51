"""Types of messages, services and actions of `simulation_interfaces` 2.1 and of GADEN, by their fields.

Sources: github.com/ros-simulation/simulation_interfaces (Apache-2.0) and gaden_msgs of github.com/MAPIRlab/gaden. Types
are known by the hash of their fields, which tests compare with those of ROS's own generator.
"""

from enum import IntEnum

from gslcosim_ros.types import RosTypes

PACKAGE = "simulation_interfaces"
GADEN_GAS, GADEN_WIND = "gaden_msgs/srv/GasPosition", "gaden_msgs/srv/WindPosition"

_MESSAGES = {
    "Result": "uint8 result\nstring error_message",
    "SimulationState": "uint8 state",
    "SimulatorFeatures": "uint16[] features\nstring[] spawn_formats\nstring custom_info",
    "EntityCategory": "uint8 category",
    "TagsFilter": "string[] tags\nuint8 filter_mode",
    "Bounds": "uint8 type\ngeometry_msgs/Vector3[] points",
    "EntityFilters": "string filter\nEntityCategory[] categories\nTagsFilter tags\nBounds bounds",
    "EntityInfo": "EntityCategory category\nstring description\nstring[] tags",
    "EntityState": (
        "std_msgs/Header header\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\ngeometry_msgs/Accel acceleration"
    ),
}
# What the generator puts into a message without fields.
_EMPTY = "uint8 structure_needs_at_least_one_member"
_SERVICES = {
    "GetSimulatorFeatures": (_EMPTY, "SimulatorFeatures features"),
    "GetSimulationState": (_EMPTY, "SimulationState state\nResult result"),
    "SetSimulationState": ("SimulationState state", "Result result"),
    "StepSimulation": ("uint64 steps", "Result result"),
    "ResetSimulation": ("uint8 scope", "Result result"),
    "GetEntities": ("EntityFilters filters", "Result result\nstring[] entities"),
    "GetEntitiesStates": ("EntityFilters filters", "Result result\nstring[] entities\nEntityState[] states"),
    "GetEntityState": ("string entity", "Result result\nEntityState state"),
    "GetEntityInfo": ("string entity", "Result result\nEntityInfo info"),
}
SIMULATE_STEPS = f"{PACKAGE}/action/SimulateSteps"
_POINTS = "float64[] x\nfloat64[] y\nfloat64[] z"
CATEGORY_ROBOT = 2
FILTER_MODE_ALL = 1


class Feature(IntEnum):
    """Features of `SimulatorFeatures` that are offered; each is exercised by a test."""

    ENTITY_TAGS = 4
    ENTITY_CATEGORIES = 8
    ENTITY_STATE_GETTING = 10
    ENTITY_INFO_GETTING = 12
    SIMULATION_RESET = 20
    SIMULATION_STATE_GETTING = 24
    SIMULATION_STATE_SETTING = 25
    SIMULATION_STATE_PAUSE = 26
    STEP_SIMULATION_SINGLE = 31
    STEP_SIMULATION_MULTIPLE = 32
    STEP_SIMULATION_ACTION = 33


class State(IntEnum):
    """States of `SimulationState`."""

    STOPPED = 0
    PLAYING = 1
    PAUSED = 2
    QUITTING = 3


class ResultCode(IntEnum):
    """Codes of `Result`; those above 100 are of `SetSimulationState`."""

    FEATURE_UNSUPPORTED = 0
    OK = 1
    NOT_FOUND = 2
    INCORRECT_STATE = 3
    OPERATION_FAILED = 4
    ALREADY_IN_TARGET_STATE = 101
    STATE_TRANSITION_ERROR = 102


class Scope(IntEnum):
    """Bits of the scope of `ResetSimulation`; 0 and 255 are all of them."""

    TIME = 1
    STATE = 2
    SPAWNED = 4


class BoundsType(IntEnum):
    """Types of `Bounds`."""

    EMPTY = 0
    BOX = 1
    CONVEX_HULL = 2
    SPHERE = 3


def get_service_type(name: str) -> str:
    """Return the type of a service of `simulation_interfaces`, for example of `StepSimulation`."""
    return f"{PACKAGE}/srv/{name}"


def define_interfaces(types: RosTypes) -> None:
    """Make the types known."""
    for name, fields in _MESSAGES.items():
        types.define_message(f"{PACKAGE}/msg/{name}", fields)
    for name, (request, response) in _SERVICES.items():
        types.define_service(get_service_type(name), request, response)
    steps = "uint64 completed_steps\nuint64 remaining_steps"
    types.define_action(SIMULATE_STEPS, "uint64 steps", "Result result", steps)
    types.define_message("gaden_msgs/msg/GasInCell", "float64[] concentration")
    types.define_service(GADEN_GAS, _POINTS, "GasInCell[] positions\nstring[] gas_type")
    types.define_service(GADEN_WIND, _POINTS, "float64[] u\nfloat64[] v\nfloat64[] w")
