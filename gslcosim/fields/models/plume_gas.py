"""Gas by a formula for the plume of each source, from its block: the mean plume, and the meandering one."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import ScenarioError
from gslcosim.fields.gas_field import GasField
from gslcosim.fields.gas_setup import GasSetup, gas_field_of_block, gases_in, release_m3_s, wind_at_first_source_m_s
from gslcosim.fields.models.formula_fields import FormulaField, FormulaPlume
from gslcosim.fields.models.formula_plume_kernels import PLUME
from gslcosim.fields.models.gaussian_plume import OPEN_COUNTRY, GaussianPlume, MeanderingPlume
from gslcosim.fields.models.numpy_loop_kernels import loop_address
from gslcosim.scenario.models.gas import FormulaGasSpec, GaussianPlumeGasSpec, MeanderingPlumeGasSpec


@gas_field_of_block.register
def _gaussian_field(gas: GaussianPlumeGasSpec, setup: GasSetup) -> GasField:
    means, columns = _means(gas, setup), _columns(gas)

    def steady(_seed: int) -> list[FormulaPlume]:
        return [
            FormulaPlume(
                gas_index=column,
                mixing_ratio_ppm_at=lambda points, _time_s, mean=mean: mean.mixing_ratio_ppm_at(points),
            )
            for column, mean in zip(columns, means, strict=True)
        ]

    return _field(gas, setup, steady)


@gas_field_of_block.register
def _meandering_field(gas: MeanderingPlumeGasSpec, setup: GasSetup) -> GasField:
    means, columns, spec = _means(gas, setup), _columns(gas), gas.plume

    def meandering(seed: int) -> list[FormulaPlume]:
        return [
            FormulaPlume(
                gas_index=column,
                mixing_ratio_ppm_at=MeanderingPlume.seeded(
                    mean,
                    instantaneous_frac=spec.instantaneous_frac,
                    correlation_s=spec.meander_s,
                    seed=seed,
                    name=str(i),
                ).mixing_ratio_ppm_at,
            )
            for i, (column, mean) in enumerate(zip(columns, means, strict=True))
        ]

    return _field(gas, setup, meandering)


def plume_records(gas: FormulaGasSpec, setup: GasSetup) -> NDArray[np.void]:
    """Return the (n,) mean plumes of the sources as records of `formula_plume_kernels.PLUME`, for kernels.

    Raises:
        ScenarioError: the air is calm.
    """
    means = _means(gas, setup)
    rows = np.zeros(len(means), PLUME)
    for row, mean, column in zip(rows, means, _columns(gas), strict=True):
        speed_m_s = float(np.hypot(*mean.wind_world_m_s[:2]))
        row["position_world_m"], row["release_m3_s"] = mean.position_world_m, mean.release_m3_s
        row["speed_m_s"], row["along"] = speed_m_s, np.array(mean.wind_world_m_s[:2]) / speed_m_s
        row["spread"], row["has_ground"], row["gas"] = OPEN_COUNTRY[mean.stability], mean.has_ground, column
    rows["exp_address"], rows["power_address"] = loop_address(np.exp), loop_address(np.power)
    return rows


def _field(gas: FormulaGasSpec, setup: GasSetup, plumes: Callable[[int], list[FormulaPlume]]) -> GasField:
    return FormulaField(plumes, gases_in(gas), step_s=setup.step_s, seed=setup.seed)


def _columns(gas: FormulaGasSpec) -> list[int]:
    gases = gases_in(gas)
    return [gases.index(source.gas or gas.gas) for source in gas.sources]


def _means(gas: FormulaGasSpec, setup: GasSetup) -> list[GaussianPlume]:
    spec = gas.plume
    wind_m_s = spec.wind_m_s or wind_at_first_source_m_s(setup.scenario, setup.environment)
    if not (wind_m_s[0] or wind_m_s[1]):
        raise ScenarioError("gas.plume.wind_m_s: expected a horizontal wind, was calm air. Give one for the plume.")
    return [
        GaussianPlume(
            position_world_m=source.position_m,
            release_m3_s=release_m3_s(source, place=f"gas.sources[{i}].release"),
            wind_world_m_s=wind_m_s,
            stability=spec.stability,
            has_ground=spec.has_ground,
        )
        for i, source in enumerate(gas.sources)
    ]
