"""Description of an FMU: its variables, step size and abilities, from the `modelDescription.xml` within it."""

# pyright: basic

import sys
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim.base.errors import UsageError, describe_os_error
from gslcosim.base.files import open_regular_file
from gslcosim.base.ticks import NS_PER_S
from gslcosim_fmi.units import UnitOfMeasure

DESCRIPTION_FILE = "modelDescription.xml"
# As much as the sandbox has room for; a description of 50,000 variables has some 20 MB.
MAX_UNPACKED_BYTES = 200 << 20
MAX_DESCRIPTION_BYTES = 64 << 20
# With sources and documentation, which are read once, for their checksums.
MAX_ARCHIVE_BYTES = 1 << 30
INSTALL_REMEDY = "Install it: pip install gslcosim-fmi."
_MAX_PROBLEM_LENGTH = 300
_PIECE_BYTES = 1 << 20
# Times are whole nanoseconds; a run is shorter than a day.
_MIN_STEP_S, _MAX_STEP_S = 1e-9, 86_400.0
# How a variable's functions are called: FMI 2 has fewer types than FMI 3.
_TYPES_OF_VERSION = {2: {"Real": "Real", "Integer": "Integer", "Enumeration": "Integer"}, 3: {"Enumeration": "Int64"}}
_FLOATS, _TRUTHS, _TEXTS = ("Real", "Float32", "Float64"), ("Boolean",), ("String",)
_OTHERS = ("Binary", "Clock")
# Of FMI 2, which has one size.
_INTEGER_BITS = 32


@dataclass(frozen=True, kw_only=True)
class FmuVariable:
    """A variable of a unit.

    Attributes:
        name: Its name.
        reference: Its value reference.
        fmi_type: How its functions are called, such as Float64.
        causality: input, output, parameter, local or another of FMI.
        variability: continuous, discrete, tunable, fixed or constant.
        measure: In which unit it is, where that is said.
        is_scalar: Whether it is one value.
    """

    name: str
    reference: int
    fmi_type: str
    causality: str
    variability: str
    measure: UnitOfMeasure | None = None
    is_scalar: bool = True

    @property
    def kind(self) -> type | None:
        """The Python type of its value; None: it has none here."""
        if self.fmi_type in _OTHERS or not self.is_scalar:
            return None
        named = ((_FLOATS, float), (_TRUTHS, bool), (_TEXTS, str))
        return next((kind for types, kind in named if self.fmi_type in types), int)

    def holds(self, value: float | str) -> bool:
        """Return whether a value of its Python type fits, which larger whole numbers do not."""
        if self.kind is not int or isinstance(value, str):
            return True
        n_bits = (
            int(self.fmi_type.removeprefix("U").removeprefix("Int")) if self.fmi_type != "Integer" else _INTEGER_BITS
        )
        low, high = (0, 1 << n_bits) if self.fmi_type.startswith("U") else (-(1 << n_bits - 1), 1 << n_bits - 1)
        return low <= value < high


@dataclass(frozen=True, kw_only=True)
class FmuDescription:
    """Description of a unit, from its XML file.

    Attributes:
        version: 2 or 3.
        model: The name of its model.
        identifier: The name of its binary.
        token: Its instantiation token (FMI 3) or GUID (FMI 2).
        variables: By name.
        fixed_step_ns: The step that it has to be given, or whose multiple it needs; None: any.
        has_fixed_steps: Whether each of its steps has to be `fixed_step_ns`, and not a multiple.
        saves_state: Whether its state can be written and read back.
        log_categories: Categories of its log; the empty one is that of messages without a category.
        binaries: Platforms that it has a binary for.
    """

    version: int
    model: str
    identifier: str
    token: str
    variables: Mapping[str, FmuVariable]
    fixed_step_ns: int | None
    has_fixed_steps: bool
    saves_state: bool
    log_categories: tuple[str, ...]
    binaries: tuple[str, ...]

    def list_names(self, *causalities: str) -> list[str]:
        """Return the names of its variables of some causalities."""
        return [variable.name for variable in self.variables.values() if variable.causality in causalities]


def read_fmu(path: Path) -> FmuDescription:
    """Read the description of a unit, of which nothing is unpacked."""
    try:
        import fmpy
    except ImportError as error:
        raise UsageError(f"expected the package fmpy, which reads FMUs, was none. {INSTALL_REMEDY}") from error
    names = _check_archive(path)
    # Its fields can be None for those who write one.
    found: Any
    try:
        found = fmpy.read_model_description(str(path), validate=True)
    except AttributeError as error:  # as where fmpy looks at the version
        expected = f"a {DESCRIPTION_FILE} with all that FMI asks for, such as fmiVersion"
        raise UsageError(f"expected {expected}, was one without") from error
    except fmpy.model_description.ValidationError as error:
        first = str(error.problems[0])[:_MAX_PROBLEM_LENGTH].rstrip(".")
        raise UsageError(f"expected a {DESCRIPTION_FILE} that follows FMI, was another: {first}") from error
    except Exception as error:
        raise UsageError(f"expected a {DESCRIPTION_FILE} that can be read, was another: {_shorten(error)}") from error
    version = int(found.fmiVersion.partition(".")[0])
    if version not in _TYPES_OF_VERSION:
        raise UsageError(f"expected FMI 2 or 3, was FMI {found.fmiVersion}")
    own = found.coSimulation
    if own is None:
        kinds = {"model exchange": found.modelExchange, "scheduled execution": found.scheduledExecution}
        there = [f"one for {kind} alone" for kind, element in kinds.items() if element is not None]
        raise UsageError(f"expected a unit for co-simulation, was {' and '.join(there) or 'one without any kind'}")
    binaries = tuple(sorted({name.split("/")[1] for name in names if name.startswith("binaries/")} - {""}))
    platform = _get_platform(version)
    binary = f"binaries/{platform}/{own.modelIdentifier}{_get_ending()}"
    if binary not in names:
        there = f"binaries for {', '.join(binaries)}" if binaries else "a unit without binaries"
        raise UsageError(f"expected {binary}, which this machine needs, was {there}")
    internal_step_s = _to_seconds(own.fixedInternalStepSize)
    step_s = internal_step_s if internal_step_s is not None else _get_experiment_step_s(found)
    has_fixed_steps = not own.canHandleVariableCommunicationStepSize and step_s is not None
    is_fixed = has_fixed_steps or internal_step_s is not None
    if is_fixed and step_s is not None and not _MIN_STEP_S <= step_s <= _MAX_STEP_S:
        raise UsageError(f"expected a fixed step from {_MIN_STEP_S:g} to {_MAX_STEP_S:g} s, was {step_s:g} s")
    measures = {unit.name: _read_measure(unit) for unit in found.unitDefinitions}
    return FmuDescription(
        version=version,
        model=found.modelName,
        identifier=own.modelIdentifier,
        token=found.guid,
        variables={each.name: _read_variable(each, version, measures) for each in found.modelVariables},
        fixed_step_ns=round(step_s * NS_PER_S) if is_fixed and step_s is not None else None,
        has_fixed_steps=has_fixed_steps,
        saves_state=bool(own.canGetAndSetFMUstate and own.canSerializeFMUstate),
        log_categories=_list_log_categories(found),
        binaries=binaries,
    )


def check_members(path: Path) -> None:
    """Check each file in the archive of a unit against its checksum."""
    with open_regular_file(path) as file, zipfile.ZipFile(file) as archive:
        for entry in archive.infolist():
            try:
                with archive.open(entry) as member:
                    while member.read(_PIECE_BYTES):
                        pass
            except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError) as error:
                expected = f"an archive whose files can be unpacked, was one with a broken {entry.filename!r}"
                raise UsageError(f"expected {expected}: {_shorten(error)}") from error


def list_unpacked_folders(version: int) -> tuple[str, ...]:
    """Return the beginnings of the names in a unit's archive that are unpacked to load it."""
    return (f"binaries/{_get_platform(version)}/", "resources/")


def _check_archive(path: Path) -> set[str]:
    try:
        with open_regular_file(path) as file, zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
            names = {entry.filename for entry in entries}
            if wrong := next((name for name in names if _leaves_archive(name)), ""):
                raise UsageError(f"expected names of files within the archive, was '{wrong}', which leads out of it")
            if DESCRIPTION_FILE not in names:
                raise UsageError(f"expected a unit with a {DESCRIPTION_FILE}, was an archive without")
            for limit, size in (
                (MAX_DESCRIPTION_BYTES, archive.getinfo(DESCRIPTION_FILE).file_size),
                (MAX_UNPACKED_BYTES, sum(e.file_size for e in entries if e.filename.startswith(("bin", "res")))),
                (MAX_ARCHIVE_BYTES, sum(e.file_size for e in entries)),
            ):
                if size > limit:
                    raise UsageError(f"expected at most {limit >> 20} MB of files, was {size >> 20} MB")
            broken = next((e.filename for e in entries if e.flag_bits & 1), "")
            if broken:
                raise UsageError(f"expected files without a password, was '{broken}' with one")
            return names
    except (zipfile.BadZipFile, EOFError, ValueError) as error:
        raise UsageError(f"expected an FMU, a whole zip archive, was another file: {_shorten(error)}") from error
    except OSError as error:
        raise UsageError(f"expected a file that can be read, was {describe_os_error(error)}") from error


def _leaves_archive(name: str) -> bool:
    return name.startswith("/") or "\\" in name or ":" in name.split("/")[0] or ".." in name.split("/")


def _get_platform(version: int) -> str:
    import fmpy

    return fmpy.platform if version == 2 else fmpy.platform_tuple


# Units on PythonFMU and PythonFMU3 log exceptions under no category, which none of those in their descriptions is.
def _list_log_categories(found: Any) -> tuple[str, ...]:
    named = tuple(category.name for category in found.logCategories if category.name)
    return (*named, "") if named and str(found.generationTool).startswith("PythonFMU") else named


def _get_ending() -> str:
    return {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def _get_experiment_step_s(found: Any) -> float | None:
    experiment = found.defaultExperiment
    return _to_seconds(experiment.stepSize) if experiment is not None else None


# fmpy leaves it as it stands in the file.
def _to_seconds(text: str | float | None) -> float | None:
    return None if text is None else float(text)


def _read_measure(unit: Any) -> UnitOfMeasure:
    base = unit.baseUnit
    if base is None:
        return UnitOfMeasure(name=unit.name)
    exponents = {key: int(getattr(base, key)) for key in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    exponents = {key: value for key, value in exponents.items() if value}
    return UnitOfMeasure(name=unit.name, exponents=exponents, factor=float(base.factor), offset=float(base.offset))


def _read_variable(each: Any, version: int, measures: Mapping[str, UnitOfMeasure]) -> FmuVariable:
    declared = each.declaredType
    name = each.unit or (declared.unit if declared is not None else None)
    return FmuVariable(
        name=each.name,
        reference=each.valueReference,
        fmi_type=_TYPES_OF_VERSION[version].get(each.type, str(each.type)),
        causality=each.causality or "local",
        variability=each.variability or "continuous",
        measure=measures.get(name, UnitOfMeasure(name=name)) if name else None,
        is_scalar=not each.dimensions,
    )


def _shorten(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text[:_MAX_PROBLEM_LENGTH].rstrip(".")
