"""Export of a room as an FMI 3.0 unit for co-simulation: its stored wind, and its recorded gas, at moving points.

The unit is C (`room_fmu.c` beside this file), compiled for this platform when it is exported; it needs no Python where
it runs. `resources/room.bin` in it holds the room in the layout that the C file describes.
"""

import argparse
import hashlib
import math
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from gslcosim import __version__
from gslcosim.base.errors import UsageError
from gslcosim.base.files import ScratchFolder
from gslcosim.base.ticks import NS_PER_S
from gslcosim.environment.export_folder import ExportResult, build_file_name, create_export_folder
from gslcosim.environment.model import AT_START, Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import SourceEventSpec
from gslcosim.scenario.models.gas import FilamentGasSpec
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, is_ideal, make_sensor_spec
from gslcosim_services.fields.gas_setup import gas_seed, gas_timing, list_gas_names
from gslcosim_services.fields.mixing_ratio import strength_ppm_m3
from gslcosim_services.fields.models.filament_gas import build_gas_model, build_wall_images
from gslcosim_services.fields.tape import MAX_SOURCES, GasTape, TapeSchedule, record_tape
from gslcosim_services.sensing.models import KernelSensorKind, sensor_kind
from gslcosim_services.sensing.models.gas_sensors import measure_pid
from gslcosim_services.sensing.models.mox import advance_mox

SOURCE_FILE = "room_fmu.c"
MAX_POINTS = 10_000
COORDINATES = ("x_m", "y_m", "z_m")
WIND_OUTPUTS = ("wind_x_m_s", "wind_y_m_s", "wind_z_m_s")
# Without contraction and reordering: samples are those of our kernels.
COMPILER_OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-fast-math", "-fPIC", "-shared", "-fvisibility=hidden")

# As the C file numbers them.
_SENSOR_KERNELS: dict[Any, int] = {advance_mox: 0, measure_pid: 1}
_N_MOX_NUMBERS = 6
_MAGIC = b"gslroom1"
_TOKEN_SIZE = 64
_CHUNK_BYTES = 1 << 24
_ARCHITECTURES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64", "i686": "x86"}
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib")}


@dataclass(frozen=True, kw_only=True)
class RecordedGas:
    """Gas of a scenario for a unit.

    Attributes:
        gases: Their names.
        strength_ppm_m3: (n_sources,) a filament's gas as volume of pure gas [ppm m3].
        gas_index: (n_sources,) gas of each source.
        first: (n_frames + 1,) where each frame begins.
        filaments: (n, 4) x, y, z and sigma [m], float32.
        sources: (n,) which source released it.
        step_s: Time between frames [s].
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        cells_to_wall: (nx, ny, nz, 6) of `count_cells_to_walls`; absent where walls do not reflect.
    """

    gases: tuple[str, ...]
    strength_ppm_m3: NDArray[np.float64]
    gas_index: NDArray[np.int64]
    first: NDArray[np.int64]
    filaments: NDArray[np.float32]
    sources: NDArray[np.uint8]
    step_s: float
    cutoff_sigma: float
    cells_to_wall: NDArray[np.uint8] | None

    @property
    def last_time_s(self) -> float:
        """Time of the last frame [s]."""
        return (len(self.first) - 2) * self.step_s


@dataclass(frozen=True, kw_only=True)
class FmuSensor:
    """A gas sensor without errors at each point of a unit.

    `model` is its name, `output` that of its variable and `unit` the variable's unit; `kind` is the number of its
    kernel in the C file, with the kernel's `parameters`.
    """

    model: str
    output: str
    unit: str
    kind: int
    parameters: tuple[float, ...]


def write_room_fmu(
    environment: Environment, folder: Path, scenario: Scenario | None, arguments: argparse.Namespace
) -> ExportResult:
    """Write a room with the options of `gslcosim environment export`; see `export_room_fmu`."""
    return export_room_fmu(
        environment,
        folder,
        scenario,
        n_points=arguments.fmu_points,
        until_s=arguments.fmu_until,
        sensors=[word.strip() for word in arguments.fmu_sensors.split(",") if word.strip()],
    )


def export_room_fmu(
    environment: Environment,
    folder: Path,
    scenario: Scenario | None = None,
    *,
    n_points: int = 1,
    until_s: float | None = None,
    sensors: Sequence[str] = (),
) -> ExportResult:
    """Write `<name>.fmu`, a room that any importer of FMI 3.0 can ask for wind and gas.

    Args:
        folder: Where; a new folder or an empty one.
        scenario: Its gas, with which the unit's time counts from the start of a run; absent: wind alone.
        n_points: At how many points at once.
        until_s: End of the recorded gas [s]; absent: the time limit of the scenario.
        sensors: Models of gas sensors at each point; see `list_fmu_sensors`.
    """
    if not 1 <= n_points <= MAX_POINTS:
        raise UsageError(f"--fmu-points: expected a number from 1 to {MAX_POINTS}, was {n_points}.")
    if scenario is None and until_s is not None:
        raise UsageError("--fmu-until: expected a scenario with it, whose gas it ends, was an environment folder.")
    if scenario is None and sensors:
        raise UsageError("--fmu-sensors: expected a scenario with it, whose gas they read, was an environment folder.")
    instruments = () if scenario is None else build_fmu_sensors(sensors, scenario)
    compiler = find_compiler()
    if scenario is not None:
        check_can_be_recorded(scenario)
    create_export_folder(folder)
    name = environment.name if scenario is None else scenario.name
    path = folder / f"{build_file_name(name)}.fmu"
    with ScratchFolder("fmu") as scratch:
        library = scratch.path / "unit"
        compile_fmu(compiler, library)
        gas = None if scenario is None else record_gas(scenario, environment, scratch.path / "tape", until_s=until_s)
        _write_fmu(path, library, name, environment, scenario, gas, instruments, n_points)
    return ExportResult(files=(path,), notices=_list_notices(environment, gas))


def check_can_be_recorded(scenario: Scenario) -> None:
    """Refuse a scenario whose gas or wind a recording cannot stand for."""
    gas = scenario.gas
    found, remedy = None, "Leave that out of the scenario"
    if not isinstance(gas, FilamentGasSpec):
        found = f"gas.model: {gas.model}"
    elif gas.rotor_downwash:
        found = "gas.rotor_downwash: true"
    elif scenario.has_wind_that_changes:
        found = "a wind that an event, a service or a participant changes"
    elif any(isinstance(event, SourceEventSpec) for event in scenario.events):
        found = "events of sources"
    elif scenario.driven_sources:
        found = "a source whose rate a participant sets"
    elif len(gas.sources) > MAX_SOURCES:
        found = f"{len(gas.sources)} sources of at most {MAX_SOURCES}"
    elif gas.eddies is not None:
        found, remedy = f"gas.turbulence: {{kind: {gas.eddies.kind}}}", "Add --set gas.turbulence.kind=none"
    if found is not None:
        raise UsageError(
            f"--to fmu: expected gas of model filament that nothing in a run changes, as the unit plays a recording, "
            f"was {found}. {remedy}, or export an environment folder, which has wind alone."
        )


def record_gas(scenario: Scenario, environment: Environment, folder: Path, *, until_s: float | None) -> RecordedGas:
    """Record the gas of a scenario at each of its steps, from the start of a run on; see `check_can_be_recorded`.

    Args:
        scenario: Its `gas`.
        folder: Where the recording lies, memory-mapped.
        until_s: Last time [s]; absent: the scenario's time limit.
    """
    assert isinstance(scenario.gas, FilamentGasSpec)
    timing = gas_timing(scenario)
    end_s = scenario.referee.stop.time_limit_s if until_s is None else until_s
    schedule = TapeSchedule(
        first_step=timing.warm_up_steps, stride=1, n_frames=math.ceil(end_s / timing.step_s - 1e-9) + 1
    )
    model = build_gas_model(scenario, environment)
    model.plume.reset(gas_seed(scenario, scenario.seed))
    record_tape(model.plume, schedule, folder)
    first, filaments, sources = GasTape(folder, is_new=True).arrays
    images = build_wall_images(scenario.gas, environment)
    live = model.plume.filaments
    return RecordedGas(
        gases=model.gases,
        strength_ppm_m3=strength_ppm_m3(live.amount_mol),
        gas_index=live.gas_index.astype(np.int64),
        first=first,
        filaments=filaments,
        sources=np.zeros(len(filaments), np.uint8) if sources is None else sources,
        step_s=timing.step_s,
        cutoff_sigma=model.cutoff_sigma,
        cells_to_wall=None if images is None else images[AT_START].counts,
    )


def list_fmu_sensors() -> tuple[str, ...]:
    """Return the models of sensors that a unit may have: those of gas at a point, without errors."""
    return tuple(name for name in SENSOR_BLOCKS if is_ideal(name) and _kernel_number(name) is not None)


def build_fmu_sensors(models: Sequence[str], scenario: Scenario) -> tuple[FmuSensor, ...]:
    """Return sensors of some models for the gases of a scenario, read once a tick of it."""
    for model in models:
        if model not in list_fmu_sensors() or list(models).count(model) > 1:
            raise UsageError(
                f"--fmu-sensors: expected some of {', '.join(list_fmu_sensors())}, each once, was {model!r}."
            )
    return tuple(_build_fmu_sensor(model, scenario) for model in models)


def _build_fmu_sensor(model: str, scenario: Scenario) -> FmuSensor:
    kind = sensor_kind(model)
    assert isinstance(kind, KernelSensorKind)
    if kind.for_gases is not None:
        kind = kind.for_gases(scenario.gas.define)
        assert isinstance(kind, KernelSensorKind)
    spec = make_sensor_spec(model=model, name="sensor")
    kernel = kind.kernel(spec, list_gas_names(scenario.gas), scenario.tick_ns / NS_PER_S)
    return FmuSensor(
        model=model,
        output=f"{model}.{kind.quantity}_{kind.unit}",
        unit=kind.unit,
        kind=_SENSOR_KERNELS[kernel.advance],
        parameters=kernel.parameters,
    )


def _kernel_number(model: str) -> int | None:
    kind = sensor_kind(model)
    if not isinstance(kind, KernelSensorKind):
        return None
    return _SENSOR_KERNELS.get(kind.kernel(make_sensor_spec(model=model, name="sensor"), (), 1.0).advance)


def find_compiler() -> list[str]:
    """Return the command of the C compiler: what `CC` names, or `cc`."""
    named = os.environ.get("CC", "")
    try:
        command = shlex.split(named) or ["cc"]
    except ValueError as error:
        raise UsageError(f"CC: expected the command of a C compiler, was {named!r}: {error}.") from error
    if shutil.which(command[0]) is None:
        raise UsageError(
            f"--to fmu: expected a C compiler to compile the unit with, was none named {command[0]}. "
            "Install one, for example with apt-get install gcc, or name yours in CC."
        )
    return command


def compile_fmu(compiler: Sequence[str], library: Path) -> None:
    """Compile the unit's C as a shared library."""
    command = [*compiler, *COMPILER_OPTIONS, "-x", "c", "-", "-o", str(library), "-lm"]
    done = subprocess.run(command, input=_read_source(), capture_output=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.decode(errors="replace").strip().splitlines() or ["nothing said"]
        # What comes last can be no more than "compilation terminated."
        reason = next((line for line in lines if "error" in line), lines[-1]).rstrip(".")
        raise UsageError(
            f"--to fmu: expected {compiler[0]} to compile the unit, was exit code {done.returncode} ({reason}). "
            "Name another C compiler in CC."
        )


def build_model_description(
    name: str,
    token: str,
    environment: Environment,
    gases: Sequence[str],
    *,
    sensors: Sequence[FmuSensor] = (),
    n_points: int,
    stop_time_s: float | None,
    step_s: float | None,
) -> bytes:
    """Return the `modelDescription.xml` of a unit.

    Args:
        name: Of the room.
        token: Identifies the content of the unit.
        gases: Names of the gases; none: wind alone.
        stop_time_s: Where the recorded gas ends [s]; absent: nowhere.
        step_s: Step to suggest [s]; absent: none.
    """
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=name,
        instantiationToken=token,
        description=f"Wind{' and gas' if gases else ''} of the room {name} at moving points",
        generationTool=f"gslcosim {__version__}",
        variableNamingConvention="structured",
    )
    ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=_identifier(name),
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for unit, dimensions in (("s", {"s": "1"}), ("m", {"m": "1"}), ("m/s", {"m": "1", "s": "-1"})):
        ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name=unit), "BaseUnit", dimensions)
    ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name="ppm"), "BaseUnit", factor="1e-6")
    ohm = ElementTree.SubElement(units, "Unit", name="ohm")
    ElementTree.SubElement(ohm, "BaseUnit", kg="1", m="2", s="-3", A="-2")
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", name="logStatusError", description="Why a call was refused")
    experiment = {"startTime": "0"}
    if stop_time_s is not None:
        experiment["stopTime"] = repr(stop_time_s)
    if step_s is not None:
        experiment["stepSize"] = repr(step_s)
    ElementTree.SubElement(root, "DefaultExperiment", experiment)
    variables = ElementTree.SubElement(root, "ModelVariables")
    structure = ElementTree.Element("ModelStructure")
    _add_variable(variables, "time", 0, "independent", "s", "time since the start of the run")
    outputs = [
        *((name, "m/s", f"wind along {name[5]}, world frame") for name in WIND_OUTPUTS),
        *((f"mixing_ratio_ppm.{gas}", "ppm", f"{gas}, by volume") for gas in gases),
        *((sensor.output, sensor.unit, f"reading of a {sensor.model} in each tick") for sensor in sensors),
    ]
    for i_point in range(n_points):
        _add_point(variables, structure, i_point, environment, outputs)
    # Sorted as the standard has it: outputs first, then what is unknown at the start.
    for output in list(structure):
        ElementTree.SubElement(structure, "InitialUnknown", output.attrib)
    root.append(structure)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


# `outputs` have a name, a unit and a text each.
def _add_point(
    variables: ElementTree.Element,
    structure: ElementTree.Element,
    i_point: int,
    environment: Environment,
    outputs: Sequence[tuple[str, str, str]],
) -> None:
    grid, prefix = environment.grid, f"point[{i_point + 1}]"
    number = 1 + i_point * (len(COORDINATES) + len(outputs))
    for axis, name in enumerate(COORDINATES):
        place = {
            "min": repr(float(grid.origin_m[axis])),
            "max": repr(float(grid.max_m[axis])),
            "start": repr(float(grid.origin_m[axis]) + 0.5 * grid.shape[axis] * float(grid.cell_m)),
        }
        text = f"{name[0]} of the point, world frame"
        _add_variable(variables, f"{prefix}.{name}", number, "input", "m", text, **place)
        number += 1
    for name, unit, text in outputs:
        _add_variable(variables, f"{prefix}.{name}", number, "output", unit, text)
        ElementTree.SubElement(structure, "Output", valueReference=str(number))
        number += 1


def _add_variable(
    variables: ElementTree.Element, name: str, number: int, causality: str, unit: str, text: str, **further: str
) -> None:
    facts = {"name": name, "valueReference": str(number), "causality": causality, "variability": "continuous"}
    ElementTree.SubElement(variables, "Float64", {**facts, "description": text, "unit": unit, **further})


def _write_fmu(
    path: Path,
    library: Path,
    name: str,
    environment: Environment,
    scenario: Scenario | None,
    gas: RecordedGas | None,
    sensors: Sequence[FmuSensor],
    n_points: int,
) -> None:
    start_s, tick_s = (0.0, 1.0) if scenario is None else (scenario.gas.warm_up_s, scenario.tick_ns / NS_PER_S)
    parts = _list_parts(environment, gas, sensors, n_points=n_points, wind_start_s=start_s, tick_s=tick_s)
    token = _hash_parts(parts)
    description = build_model_description(
        name,
        token,
        environment,
        () if gas is None else gas.gases,
        sensors=sensors,
        n_points=n_points,
        stop_time_s=None if gas is None else gas.last_time_s,
        step_s=None if scenario is None else tick_s,
    )
    architecture, system, suffix = find_platform()
    # Beside it first: nobody takes a part for the unit.
    part = path.with_name(f".{path.name}.part")
    head = _MAGIC + token.encode().ljust(_TOKEN_SIZE, b"\0")
    try:
        with zipfile.ZipFile(part, "w") as unit:
            _add_member(unit, "modelDescription.xml", [description])
            _add_member(unit, f"binaries/{architecture}-{system}/{_identifier(name)}{suffix}", [library.read_bytes()])
            _add_member(unit, f"sources/{SOURCE_FILE}", [_read_source()])
            _add_member(unit, "sources/buildDescription.xml", [_build_build_description(_identifier(name))])
            _add_member(unit, "resources/room.bin", [head, *parts])
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


# The same room gives the same bytes, whenever it is exported.
def _add_member(unit: zipfile.ZipFile, name: str, parts: Sequence[Any]) -> None:
    member = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    member.compress_type = zipfile.ZIP_DEFLATED
    member.external_attr = 0o644 << 16
    with unit.open(member, "w", force_zip64=True) as file:
        for part in parts:
            content = memoryview(part).cast("B")
            for begin in range(0, len(content), _CHUNK_BYTES):
                file.write(content[begin : begin + _CHUNK_BYTES])


# What follows magic and token in room.bin; the C file has the layout.
def _list_parts(
    environment: Environment,
    gas: RecordedGas | None,
    sensors: Sequence[FmuSensor],
    *,
    n_points: int,
    wind_start_s: float,
    tick_s: float,
) -> list[NDArray[Any]]:
    grid, wind = environment.grid, environment.wind
    n_gases = 0 if gas is None else len(gas.gases)
    counts = [n_points, n_gases, len(sensors), *grid.shape, len(wind.velocity_m_s), wind.is_looping]
    of_gas = [0, 0, 0, 0, 0]
    lengths = [*grid.origin_m, grid.cell_m, wind.period_s, wind_start_s, 1.0, 1.0, tick_s]
    if gas is not None:
        has_images = gas.cells_to_wall is not None
        of_gas = [1, len(gas.strength_ppm_m3), len(gas.first) - 1, len(gas.filaments), has_images]
        lengths[-3:-1] = [gas.step_s, gas.cutoff_sigma]
    parts = [np.array([*counts, *of_gas], "<i8"), np.array(lengths, "<f8")]
    if gas is not None:
        sensor_numbers = np.zeros((len(sensors), _N_MOX_NUMBERS + 2 * n_gases), "<f8")
        for row, sensor in zip(sensor_numbers, sensors, strict=True):
            row[: len(sensor.parameters)] = sensor.parameters
        parts += [gas.strength_ppm_m3.astype("<f8"), gas.gas_index.astype("<i8")]
        parts += [np.array([sensor.kind for sensor in sensors], "<i8"), sensor_numbers, gas.first.astype("<i8")]
        parts.append(np.ascontiguousarray(environment.occupancy, np.uint8))
        if gas.cells_to_wall is not None:
            parts.append(gas.cells_to_wall)
    parts.append(np.ascontiguousarray(wind.velocity_m_s, "<f4"))
    if gas is not None:
        parts += [np.ascontiguousarray(gas.filaments, "<f4"), gas.sources]
    return [part for part in parts if part.size]


def _hash_parts(parts: Sequence[NDArray[Any]]) -> str:
    digest = hashlib.blake2b(_MAGIC, digest_size=16)
    for part in parts:
        digest.update(part.data.cast("B"))
    return digest.hexdigest()


# Importers on other platforms compile the unit by it.
def _build_build_description(identifier: str) -> bytes:
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    sources = ElementTree.SubElement(build, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off")
    ElementTree.SubElement(sources, "SourceFile", name=SOURCE_FILE)
    ElementTree.SubElement(build, "Library", name="m", external="true")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def find_platform() -> tuple[str, str, str]:
    """Return architecture, system and ending of libraries as FMI 3.0 names this platform."""
    machine = platform.machine().lower()
    if machine not in _ARCHITECTURES or sys.platform not in _SYSTEMS:
        raise UsageError(f"--to fmu: expected Linux or macOS on x86 or ARM, was {sys.platform} on {machine}.")
    return (_ARCHITECTURES[machine], *_SYSTEMS[sys.platform])


def _identifier(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]+", "_", name if name[:1].isalpha() else f"room_{name}")


def _read_source() -> bytes:
    return Path(__file__).with_name(SOURCE_FILE).read_bytes()


def _list_notices(environment: Environment, gas: RecordedGas | None) -> tuple[str, ...]:
    if gas is None:
        return (f"The unit has the wind of {environment.name} and no gas; name a scenario for gas.",)
    size_mb = gas.filaments.nbytes / 1e6
    return (
        f"Gas is recorded from 0 s to {gas.last_time_s:g} s ({size_mb:.1f} MB of filaments); a step beyond is refused.",
    )
