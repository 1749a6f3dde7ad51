"""Vehicle models: an MJCF body and a file of parameters, each with its origin, in one folder per model."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import mujoco
import yaml

from gslcosim.errors import ModelError

Vec3 = tuple[float, float, float]
Parameters = TypeVar("Parameters", "BodyParameters", "ControlParameters", "RotorParameters", "WheelParameters")

VEHICLES_DIR = Path(__file__).parent / "vehicles"


@dataclass(frozen=True, kw_only=True)
class BodyParameters:
    """Reach of a vehicle from its centre, seen from above, and how fast it turns; origins in `parameters.yaml`."""

    radius_m: float
    max_yaw_rate_rad_s: float


@dataclass(frozen=True, kw_only=True)
class ControlParameters:
    """Gains of a vehicle in the air; meaning and origin of each number stand in `parameters.yaml`.

    Gains are per unit of mass and inertia: position [1/s^2], velocity [1/s], integral [1/s^3], attitude [1/s^2] and
    rate [1/s] about the body axes.
    """

    position_gain_s2: float
    velocity_gain_s: float
    integral_gain_s3: float
    integral_limit_m_s2: float
    max_tilt_rad: float
    attitude_gain_s2: Vec3
    rate_gain_s: Vec3


@dataclass(frozen=True, kw_only=True)
class RotorParameters:
    """Rotors and drag of a vehicle; meaning and origin of each number stand in `parameters.yaml`."""

    rotor_directions: tuple[float, float, float, float]
    thrust_coefficient_n_s2: float
    torque_per_thrust_m: float
    max_rotor_speed_rad_s: float
    time_constant_up_s: float
    time_constant_down_s: float
    rotor_drag_n_s2_m: Vec3
    drag_area_m2: Vec3
    air_density_kg_m3: float


@dataclass(frozen=True, kw_only=True)
class WheelParameters:
    """Drive of a vehicle on two wheels; meaning and origin of each number stand in `parameters.yaml`.

    Where the wheels are and how large is in the MJCF: sites `wheel_left` and `wheel_right`, geoms of the same names.
    """

    max_speed_m_s: float
    max_acceleration_m_s2: float
    max_wheel_torque_n_m: float
    wheel_gain_n_m_s: float
    wheel_integral_gain_n_m: float
    along_gain_s: float
    across_gain_m2: float
    heading_gain_s: float


@dataclass(frozen=True, kw_only=True)
class VehicleModel:
    """A vehicle as it stands in its folder.

    With rotors or without it is in the air, and `control` says how it is held there; without rotors it is moved by any
    force and does not feel the air. With wheels it drives.
    """

    name: str
    mjcf_path: Path
    body: BodyParameters
    control: ControlParameters | None
    rotors: RotorParameters | None
    wheels: WheelParameters | None

    def body_spec(self) -> mujoco.MjSpec:
        """Return a fresh MJCF specification with the one body of the vehicle, named `body`."""
        return mujoco.MjSpec.from_file(str(self.mjcf_path))


def load_vehicle(name: str) -> VehicleModel:
    """Return a vehicle model by name.

    Raises:
        ModelError: a parameter is missing, unknown, or has no origin.
    """
    return _loaded(VEHICLES_DIR / name)


# Read once in a process: a suite flies the same vehicle thousands of times.
@cache
def _loaded(folder: Path) -> VehicleModel:
    name, path = folder.name, folder / "parameters.yaml"
    sections: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    problems: list[str] = []
    body = _parameters(BodyParameters, sections, "body", problems)
    control = _parameters(ControlParameters, sections, "control", problems) if "wheels" not in sections else None
    rotors = _parameters(RotorParameters, sections, "rotors", problems) if "rotors" in sections else None
    wheels = _parameters(WheelParameters, sections, "wheels", problems) if "wheels" in sections else None
    if problems or body is None:
        raise ModelError("\n".join([*problems, f"File: {path}"]))
    mjcf_path = folder / f"{name}.xml"
    return VehicleModel(name=name, mjcf_path=mjcf_path, body=body, control=control, rotors=rotors, wheels=wheels)


def _parameters(
    kind: type[Parameters], sections: dict[str, Any], section: str, problems: list[str]
) -> Parameters | None:
    entries: dict[str, Any] = sections.get(section, {})
    expected = {f.name for f in fields(kind)}
    found = [f"{section}.{key}: expected a parameter, was missing." for key in sorted(expected - entries.keys())]
    found += [f"{section}.{key}: expected one of {sorted(expected)}." for key in sorted(entries.keys() - expected)]
    found += [f"{section}.{key}: expected an origin, was missing." for key in entries if not entries[key].get("origin")]
    problems += found
    return None if found else kind(**{key: _frozen(entry["value"]) for key, entry in entries.items()})


def _frozen(value: Any) -> Any:
    return tuple(float(v) for v in value) if isinstance(value, list) else value
