"""Provenance of an environment's wind: its maker, whether it settled, and whether stored gas belongs to it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

from gslcosim.base.files import read_regular_file
from gslcosim.base.problems import Problem
from gslcosim.base.yaml_core import BoundedLoader
from gslcosim.environment.store import HEADER_FILE, REPORT_FILE
from gslcosim.scenario import Scenario

WindMaker = Literal["built_in", "openfoam", "uniform", "file", "imported", "package", "unknown"]
# A report has a few numbers for each compared pair of windows; headers have the boxes of large buildings.
_MAX_BYTES = 64_000_000
_MADE_FROM = "\nmade_from:"


@dataclass(frozen=True, kw_only=True)
class WindProvenance:
    """Origin of an environment's wind, and the known facts about its quality.

    Attributes:
        maker: The built-in solver, OpenFOAM, uniform wind, a file of the scenario, the imported environment, the
            solver of another package, or unknown for an environment folder that does not name it.
        name: The solver's name, or the source file or folder.
        has_settled: True when the statistics of a solved wind had settled; absent where unchecked.
        uncertainty_frac: Lower bound of the standard error of the mean wind over its speed; absent where unknown.
        end_time_s: Simulated time of the solve [s]; absent where it was not solved here.
    """

    maker: WindMaker
    name: str
    has_settled: bool | None = None
    uncertainty_frac: float | None = None
    end_time_s: float | None = None


def read_wind_provenance(scenario: Scenario, folder: Path) -> WindProvenance:
    """Return the provenance of the wind in an environment folder.

    Args:
        scenario: The scenario of that environment.
        folder: The folder, generated or given.
    """
    report = _read_report(folder / REPORT_FILE)
    if report is not None:
        settling = report.get("settling") or {}
        return WindProvenance(
            maker="built_in",
            name="built_in",
            has_settled=settling.get("has_settled"),
            uncertainty_frac=settling.get("uncertainty_frac"),
            end_time_s=report.get("end_time_s"),
        )
    spec = scenario.environment
    if spec.path is not None:
        # The wind block of a scenario has no effect on a folder that has a wind.
        made_from = read_made_from(folder / HEADER_FILE)
        wind = made_from.get("wind")
        solver = wind.get("solver") if isinstance(wind, Mapping) else None
        sources = [text for key, text in made_from.items() if isinstance(text, str) and key != "format"]
        source = next(iter(sources), spec.path)
    else:
        solver, source = scenario.wind.solver, str(getattr(spec, spec.folder_key or "", ""))
    match solver:
        case {"file": str(file)}:
            return WindProvenance(maker="file", name=file)
        case "auto" | "stored":
            return WindProvenance(maker="imported", name=source)
        case "openfoam" | "uniform":
            return WindProvenance(maker=solver, name=solver)
        case None | "built_in":
            # The report of the built-in solver is missing.
            return WindProvenance(maker="unknown", name=str(spec.path))
        case _:
            return WindProvenance(maker="package", name=str(solver))


def find_mixed_air(scenario: Scenario, maker: WindMaker) -> Problem | None:
    """Return a problem where stored gas does not belong to the wind beside it; None where it may.

    Gas that is played back was carried by the wind of its own simulation. An anemometer beside it reads the wind of the
    environment: two airs in one run, unless both come from one simulation.
    """
    folder = scenario.gas.stored_folder
    if folder is None or maker in ("file", "imported", "unknown"):
        return None
    winds = {"uniform": "the same wind everywhere", "package": f"the wind of {scenario.wind.kind_name}"}
    return Problem(
        where="gas.playback.folder",
        expected="the wind in which this gas was simulated beside it",
        found=f"'{folder}' with {winds.get(maker, f'a wind that {maker} has solved')}",
        remedy="Give that wind with wind.solver: {file: PATH}, or let gslcosim carry the gas (gas.model: filament); "
        "otherwise what an anemometer reads has not carried this gas.",
    )


def _read_report(path: Path) -> dict[str, Any] | None:
    try:
        report = json.loads(read_regular_file(path, max_bytes=_MAX_BYTES))
    except (OSError, ValueError):
        return None
    return report if isinstance(report, dict) else None


def read_made_from(path: Path) -> Mapping[str, Any]:
    """Return the recipe in an environment's header, whose boxes are not parsed; nothing if it has none."""
    try:
        _, key, rest = read_regular_file(path, max_bytes=_MAX_BYTES).decode().rpartition(_MADE_FROM)
        made_from = yaml.load(key + rest, Loader=BoundedLoader)["made_from"]
    except (OSError, ValueError, LookupError, TypeError, yaml.YAMLError):
        return {}
    return made_from if isinstance(made_from, Mapping) else {}
