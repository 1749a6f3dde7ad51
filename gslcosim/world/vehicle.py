"""Vehicle models: an MJCF body and a file of parameters, each with its origin, in one folder per model."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import mujoco
import yaml

from gslcosim.errors import ModelError

Vec3 = tuple[float, float, float]
Parameters = TypeVar("Parameters", "ControlParameters", "RotorParameters")

VEHICLES_DIR = Path(__file__).parent / "vehicles"


@dataclass(frozen=True, kw_only=True)
class ControlParameters:
    """Size and gains of a vehicle; meaning and origin of each number stand in `parameters.yaml`.

    Gains are per unit of mass and inertia: position [1/s^2], velocity [1/s], integral [1/s^3], attitude [1/s^2] and
    rate [1/s] about the body axes.
    """

    radius_m: float
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
class VehicleModel:
    """A vehicle as it stands in its folder; without rotors it is moved by any force and does not feel the air."""

    name: str
    mjcf_path: Path
    control: ControlParameters
    rotors: RotorParameters | None

    def body_spec(self) -> mujoco.MjSpec:
        """Return a fresh MJCF specification with the one body of the vehicle, named `body`."""
        return mujoco.MjSpec.from_file(str(self.mjcf_path))


def load_vehicle(name: str) -> VehicleModel:
    """Return a vehicle model by name.

    Raises:
        ModelError: a parameter is missing, unknown, or has no origin.
    """
    folder = VEHICLES_DIR / name
    path = folder / "parameters.yaml"
    sections: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    problems: list[str] = []
    control = _parameters(ControlParameters, sections["control"], "control", problems)
    rotors = _parameters(RotorParameters, sections["rotors"], "rotors", problems) if "rotors" in sections else None
    if problems or control is None:
        raise ModelError("\n".join([*problems, f"File: {path}"]))
    return VehicleModel(name=name, mjcf_path=folder / f"{name}.xml", control=control, rotors=rotors)


def _parameters(
    kind: type[Parameters], entries: dict[str, Any], section: str, problems: list[str]
) -> Parameters | None:
    expected = {f.name for f in fields(kind)}
    found = [f"{section}.{key}: expected a parameter, was missing." for key in sorted(expected - entries.keys())]
    found += [f"{section}.{key}: expected one of {sorted(expected)}." for key in sorted(entries.keys() - expected)]
    found += [f"{section}.{key}: expected an origin, was missing." for key in entries if not entries[key].get("origin")]
    problems += found
    return None if found else kind(**{key: _frozen(entry["value"]) for key, entry in entries.items()})


def _frozen(value: Any) -> Any:
    return tuple(float(v) for v in value) if isinstance(value, list) else value
