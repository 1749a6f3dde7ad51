"""Tables of docs/sensors.md: `python docs/_build/sensors_page.py docs/sensors.md`."""

import math
import re
import sys
from pathlib import Path

from gslcosim.base.gases import GASES, PID_LAMPS_EV
from gslcosim.scenario.model_schema import SettingRow, list_settings
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, SENSORS, is_ideal, real_model
from gslcosim_services.sensing.models import SENSOR_MODELS, SensorKind
from gslcosim_services.sensing.models.mox import MOX_PARAMETERS, MoxParameters

_BLOCK = re.compile(r"(<!-- table (\w+), rewritten by `make docs` -->\n)(.*?)(\n<!-- end of table -->)", re.DOTALL)


def fill_tables(page: str) -> str:
    """Return the text of docs/sensors.md with its tables as the code has them."""
    tables = {"models": _model_rows, "settings": _setting_rows, "mox": _mox_rows, "pid": _pid_rows}
    return _BLOCK.sub(lambda found: f"{found[1]}\n{tables[found[2]]()}{found[4]}", page)


def _model_rows() -> str:
    kinds = [SENSOR_MODELS[name] for name in SENSORS]
    rows = [f"| `{kind.name}` | {kind.quantity} | {kind.unit} | {_what(kind)} |" for kind in kinds]
    return "\n".join(["| model | quantity | unit | what it is |", "|---|---|---|---|", *rows]) + "\n"


def _what(kind: SensorKind) -> str:
    return f"`{real_model(kind.name)}` without errors." if is_ideal(kind.name) else kind.description


# A row for each setting, whatever the number of models that have it; what all have comes first.
def _setting_rows() -> str:
    owners: dict[SettingRow, list[str]] = {}
    real = {name: block for name, block in SENSOR_BLOCKS.items() if not is_ideal(name)}
    for name, block in real.items():
        for setting in list_settings(block, kind=name, without=frozenset({"model"})):
            owners.setdefault(setting, []).append(name)
    ranked = sorted(owners.items(), key=lambda item: len(item[1]) < len(real))
    rows = [
        f"| `{each.key}` | {each.unit} | {each.default} | {each.meaning} | {_models(names)} |" for each, names in ranked
    ]
    return "\n".join(["| setting | unit | default | meaning | models |", "|---|---|---|---|---|", *rows]) + "\n"


def _models(names: list[str]) -> str:
    if len(names) == sum(not is_ideal(name) for name in SENSOR_BLOCKS):
        return "all"
    mox = list(MOX_PARAMETERS)
    if set(mox) <= set(names):
        names = ["MOX", *(name for name in names if name not in mox)]
    return ", ".join(names)


def _mox_rows() -> str:
    head = "| model | R0 [ohm] | clean air Rs/R0 | rise, decay [s] | ethanol A, B; floor [ppm] | methane | hydrogen |"
    rows = [
        f"| `{p.model}` | {p.r0_ohm:g} | {p.air_ratio:g} | {p.rise_s:g}, {p.decay_s:g} | "
        + " | ".join(_law(p, gas) for gas in ("ethanol", "methane", "hydrogen"))
        + " |"
        for p in MOX_PARAMETERS.values()
    ]
    return "\n".join([head, "|---|---|---|---|---|---|---|", *rows]) + "\n"


def _law(parameters: MoxParameters, gas: str) -> str:
    if gas not in parameters.power_law:
        return "no figures"
    a, b = parameters.power_law[gas]
    floor_ppm = parameters.floor_ppm(gas)
    return f"{a:g}, {b:g}; {'never noticed' if math.isinf(floor_ppm) else f'{floor_ppm:.3g}'}"


def _pid_rows() -> str:
    rows = [
        f"| {name} | {gas.ionisation_ev:g} | " + " | ".join(_factor(gas.pid.get(lamp)) for lamp in PID_LAMPS_EV) + " |"
        for name, gas in GASES.items()
        if gas.pid
    ]
    return (
        "\n".join(["| gas | ionisation energy [eV] | CF at 10.6 eV | CF at 11.7 eV |", "|---|---|---|---|", *rows])
        + "\n"
    )


def _factor(factor: float | None) -> str:
    return "not seen" if factor is None else f"{factor:g}"


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(fill_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
