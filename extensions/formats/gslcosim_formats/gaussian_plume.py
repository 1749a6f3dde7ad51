"""Gaussian plumes behind point sources in even wind: the steady mean, and one that meanders."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError, ScenarioError
from gslcosim.base.quantities import Vec3
from gslcosim.base.rng import stream
from gslcosim.base.scalar_kernels import norm2
from gslcosim.base.spec import Positive, Spec
from gslcosim.environment.grid_kernels import trilinear_wind_at_points
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import GasSpec
from gslcosim_formats.formula_fields import FormulaField, FormulaPlume
from gslcosim_services.fields.gas_field import GasField
from gslcosim_services.fields.gas_setup import (
    GasSetup,
    build_gas_field_from_block,
    list_gas_names,
    mean_release_m3_s,
)
from gslcosim_services.fields.mixing_ratio import check_points

StabilityClass = Literal["A", "B", "C", "D", "E", "F"]

# sigma_y = a x / sqrt(1 + 1e-4 x); sigma_z = b x (1 + c x)^p: (a, b, c, p) of each class, x in metres.
OPEN_COUNTRY = {
    "A": (0.22, 0.20, 0.0, 0.0),
    "B": (0.16, 0.12, 0.0, 0.0),
    "C": (0.11, 0.08, 2e-4, -0.5),
    "D": (0.08, 0.06, 1.5e-3, -0.5),
    "E": (0.06, 0.03, 3e-4, -1.0),
    "F": (0.04, 0.016, 3e-4, -1.0),
}
# Knots of a path in a correlation time; between them it is interpolated.
KNOTS_PER_CORRELATION_TIME = 20
KNOT_CORRELATION = elementary.exp(-1.0 / KNOTS_PER_CORRELATION_TIME)


class PlumeSpec(Spec):
    """Settings of `gaussian_plume` and `meandering_plume`.

    A meandering plume is at any moment `instantaneous_frac` as wide as its mean, and wanders within that mean with the
    correlation time `meander_s`.
    """

    stability: Literal["A", "B", "C", "D", "E", "F"] = Field(default="D", description="Pasquill's class")
    wind_m_s: Vec3 | None = Field(
        default=None, description="uniform wind (absent: wind of the room at the first source)"
    )
    has_ground: bool = Field(default=True, description="reflect the plume at z = 0")
    instantaneous_frac: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.5, description="instantaneous width of a meandering plume as a fraction of the mean width"
    )
    meander_s: Positive = Field(default=20.0, description="correlation time of a meandering plume")


class FormulaGasSpec(GasSpec):
    """Base of gas models with a formula for the plume."""

    is_in_open_air: ClassVar[bool] = True
    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "plume.instantaneous_frac": ("meandering_plume",),
        "plume.meander_s": ("meandering_plume",),
    }

    plume: PlumeSpec = Field(default=PlumeSpec(), description="shape and wind of the plume")


class GaussianPlumeGasSpec(FormulaGasSpec):
    """The mean plume of each source, by Gauss's formula."""

    model: Literal["gaussian_plume"] = Field(  # pyright: ignore
        default="gaussian_plume", description="gas model"
    )


class MeanderingPlumeGasSpec(FormulaGasSpec):
    """A narrower plume that moves about within the mean one."""

    model: Literal["meandering_plume"] = Field(  # pyright: ignore
        default="meandering_plume", description="gas model"
    )


def spreads_m(downwind_m: NDArray[np.float64], stability: StabilityClass) -> tuple[NDArray, NDArray]:
    """Return the plume's standard deviations across the wind and upward at distances downwind.

    Args:
        downwind_m: (n,) distance from the source along the wind x [m], > 0; meant for 100 m to 10 km.
        stability: Pasquill's class, A very unstable to F stable.

    Returns:
        (n,) sigma_y and (n,) sigma_z [m].

    Source:
        Briggs 1973, Diffusion estimation for small emissions, ATDL contribution 79, formulas for open country.
    Held by:
        extensions/formats/tests/unit/test_gaussian_plume.py
    """
    a, b, c, p = OPEN_COUNTRY[stability]
    return a * downwind_m / np.sqrt(1.0 + 1e-4 * downwind_m), b * downwind_m * elementary.pow_each(
        1.0 + c * downwind_m, p
    )


@dataclass(frozen=True, kw_only=True)
class GaussianPlume:
    """A continuous point source in even, horizontal wind; the ground reflects the plume.

    C = Q / (2 pi sy sz u) exp(-y^2 / (2 sy^2)) (exp(-(z - h)^2 / (2 sz^2)) + exp(-(z + h)^2 / (2 sz^2)))
    [1] = [m3/s] / ([m] [m] [m/s]); times 1e6 for ppm. x, y along and across the wind, z above ground, h the source's.

    `release_m3_s` is the volume of pure gas per second Q, `wind_world_m_s` the wind, whose vertical part counts as
    zero, `stability` the class of `spreads_m`. Upwind of the source there is no gas. Without `has_ground` the second
    term is left out: the thesis's eq. 5.1.

    Source: GSL-Bench thesis, eq. 5.1, with the image source of every textbook on air pollution.
    Left out: spread along the wind; walls; calm air (refused).
    Held by: extensions/formats/tests/unit/test_gaussian_plume.py
    """

    position_world_m: Vec3
    release_m3_s: float
    wind_world_m_s: Vec3
    stability: StabilityClass = "D"
    has_ground: bool = True

    def mixing_ratio_ppm_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (n,) mixing ratio [ppm by volume] at (n, 3) points, world frame [m]."""
        points = check_points(points_world_m)
        x_m, y_m, speed_m_s = self.along_and_across_m(points)
        sigma_y_m, sigma_z_m = spreads_m(np.where(x_m > 0.0, x_m, 1.0), self.stability)
        return self._mixing_ratio_ppm(x_m, y_m, points[:, 2], 0.0, sigma_y_m, sigma_z_m, speed_m_s)

    def along_and_across_m(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return (n,) distances along and across the wind [m] of (n, 3) points, and the wind's speed [m/s]."""
        speed_m_s = norm2(self.wind_world_m_s[0], self.wind_world_m_s[1])
        if speed_m_s == 0.0:
            raise ModelError("gaussian plume: expected a horizontal wind that is not zero, was calm air.")
        along = np.array(self.wind_world_m_s[:2]) / speed_m_s
        offset_m = points[:, :2] - np.array(self.position_world_m[:2])
        # Not as a matrix product, whose last digits depend on how many points there are.
        u, v = along
        return offset_m[:, 0] * u + offset_m[:, 1] * v, offset_m[:, 0] * -v + offset_m[:, 1] * u, speed_m_s

    # `rise_m` (n,) or 0: how far the plume's axis is above the source's height.
    def _mixing_ratio_ppm(
        self,
        x_m: NDArray[np.float64],
        y_m: NDArray[np.float64],
        z_m: NDArray[np.float64],
        rise_m: NDArray[np.float64] | float,
        sigma_y_m: NDArray[np.float64],
        sigma_z_m: NDArray[np.float64],
        speed_m_s: float,
    ) -> NDArray[np.float64]:
        h_m = self.position_world_m[2] + rise_m
        upward = elementary.exp_each(-np.square(z_m - h_m) / (2.0 * (sigma_z_m * sigma_z_m)))
        if self.has_ground:
            upward = upward + elementary.exp_each(-np.square(z_m + h_m) / (2.0 * (sigma_z_m * sigma_z_m)))
        across = elementary.exp_each(-(y_m * y_m) / (2.0 * (sigma_y_m * sigma_y_m)))
        ppm = 1e6 * self.release_m3_s / (2.0 * np.pi * sigma_y_m * sigma_z_m * speed_m_s) * across * upward
        return np.where(x_m > 0.0, ppm, 0.0)


class WanderingPath:
    """A smooth random function of time with mean 0, variance 1 and exponential correlation at its knots.

    Knots are a twentieth of the correlation time apart and exact: xi(k + 1) = rho xi(k) + sqrt(1 - rho^2) n,
    rho = exp(-h / T). Between two of them the weights are scaled so that the variance is 1 at every time. The path
    depends on the stream alone, not on when it is asked.

    Held by: extensions/formats/tests/unit/test_meandering_plume.py
    """

    def __init__(self, rng: np.random.Generator, correlation_s: float) -> None:
        self._rng = rng
        self._knot_s = correlation_s / KNOTS_PER_CORRELATION_TIME
        self._rho = KNOT_CORRELATION
        self._knots = np.array([rng.standard_normal()])

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (n,) values at (n,) times [s], which count as 0 when negative."""
        position = np.maximum(time_s, 0.0) / self._knot_s
        i = position.astype(np.int64)
        self._extend(int(i.max(initial=0)) + 2)
        a = position - i
        scale = np.sqrt((1.0 - a) * (1.0 - a) + a * a + 2.0 * a * (1.0 - a) * self._rho)
        return ((1.0 - a) * self._knots[i] + a * self._knots[i + 1]) / scale

    def _extend(self, n: int) -> None:
        n_new = n - len(self._knots)
        if n_new <= 0:
            return
        draws = self._rng.standard_normal(n_new) * math.sqrt(1.0 - self._rho * self._rho)
        knots = [float(self._knots[-1])]
        for draw in draws.tolist():
            knots.append(self._rho * knots[-1] + draw)
        self._knots = np.concatenate([self._knots, knots[1:]])


@dataclass(frozen=True, kw_only=True)
class MeanderingPlume:
    """A narrow Gaussian plume whose axis wanders, so that its time mean is the wide one of `GaussianPlume`.

    sigma_i = f sigma(x); axis: y_c(x, t) = sqrt(1 - f^2) sigma_y(x) xi(t - x / u), z_c likewise with sigma_z
    sigma_i^2 + <y_c^2> = sigma^2; [m2]. f is `instantaneous_frac`, xi a `WanderingPath` of its own for y and z.

    What left the source at one time keeps its side of the axis on its way, as if frozen. The plume's front reaches x at
    the time x / u: before, there is no gas.

    Source: Gifford 1959, Statistical properties of a fluctuating plume dispersion model, Advances in Geophysics 6.
    Deviation: the share f is the same at all distances; in the atmosphere it grows to 1 far away.
    Left out: fluctuation within the instantaneous plume.
    Held by: extensions/formats/tests/unit/test_meandering_plume.py
    """

    mean: GaussianPlume
    instantaneous_frac: float
    sideways: WanderingPath
    upward: WanderingPath

    @classmethod
    def seeded(
        cls, mean: GaussianPlume, *, instantaneous_frac: float, correlation_s: float, seed: int, name: str
    ) -> "MeanderingPlume":
        """Return the plume of a seed; `name` keeps its streams apart from those of others."""
        return cls(
            mean=mean,
            instantaneous_frac=instantaneous_frac,
            sideways=WanderingPath(stream(seed, f"fields.meander.{name}.y"), correlation_s),
            upward=WanderingPath(stream(seed, f"fields.meander.{name}.z"), correlation_s),
        )

    def mixing_ratio_ppm_at(self, points_world_m: NDArray[np.float64], time_s: float) -> NDArray[np.float64]:
        """Return the (n,) mixing ratio [ppm by volume] at (n, 3) points, world frame [m], and a time [s]."""
        points = check_points(points_world_m)
        x_m, y_m, speed_m_s = self.mean.along_and_across_m(points)
        sigma_y_m, sigma_z_m = spreads_m(np.where(x_m > 0.0, x_m, 1.0), self.mean.stability)
        left_s = time_s - np.maximum(x_m, 0.0) / speed_m_s
        wander = math.sqrt(1.0 - self.instantaneous_frac * self.instantaneous_frac)
        f = self.instantaneous_frac
        ppm = self.mean._mixing_ratio_ppm(
            x_m,
            y_m - wander * sigma_y_m * self.sideways.at(left_s),
            points[:, 2],
            wander * sigma_z_m * self.upward.at(left_s),
            f * sigma_y_m,
            f * sigma_z_m,
            speed_m_s,
        )
        return np.where(left_s >= 0.0, ppm, 0.0)


@build_gas_field_from_block.register
def _build_gaussian_field(gas: GaussianPlumeGasSpec, setup: GasSetup) -> GasField:
    means, columns = build_mean_plumes(gas, setup), list_gas_columns(gas)

    def steady(_seed: int) -> list[FormulaPlume]:
        return [
            FormulaPlume(
                gas_index=column,
                mixing_ratio_ppm_at=lambda points, _time_s, mean=mean: mean.mixing_ratio_ppm_at(points),
            )
            for column, mean in zip(columns, means, strict=True)
        ]

    return _build_field(gas, setup, steady)


@build_gas_field_from_block.register
def _build_meandering_field(gas: MeanderingPlumeGasSpec, setup: GasSetup) -> GasField:
    means, columns, spec = build_mean_plumes(gas, setup), list_gas_columns(gas), gas.plume

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

    return _build_field(gas, setup, meandering)


def _build_field(gas: FormulaGasSpec, setup: GasSetup, plumes: Callable[[int], list[FormulaPlume]]) -> GasField:
    return FormulaField(plumes, list_gas_names(gas), step_s=setup.step_s, seed=setup.seed)


def list_gas_columns(gas: FormulaGasSpec) -> list[int]:
    """Return which of the scenario's gases each source releases."""
    gases = list_gas_names(gas)
    return [gases.index(source.gas or gas.gas) for source in gas.sources]


def build_mean_plumes(gas: FormulaGasSpec, setup: GasSetup) -> list[GaussianPlume]:
    """Return the mean plume of each source."""
    spec = gas.plume
    wind_m_s = spec.wind_m_s or wind_at_first_source_m_s(setup.scenario, setup.environment)
    if not (wind_m_s[0] or wind_m_s[1]):
        raise ScenarioError("gas.plume.wind_m_s: expected a horizontal wind, was calm air. Give one for the plume.")
    return [
        GaussianPlume(
            position_world_m=source.position_m,
            release_m3_s=mean_release_m3_s(source, place=f"gas.sources[{i}].release"),
            wind_world_m_s=wind_m_s,
            stability=spec.stability,
            has_ground=spec.has_ground,
        )
        for i, source in enumerate(gas.sources)
    ]


def wind_at_first_source_m_s(scenario: Scenario, environment: Environment) -> Vec3:
    """Return the room's horizontal wind at the first source, the mean over its frames [m/s]."""
    grid = environment.grid
    place = np.array([scenario.gas.sources[0].position_m], np.float64)
    frames = environment.wind.velocity_m_s
    winds = [trilinear_wind_at_points(frame, grid.origin_m, grid.cell_m, place)[0] for frame in frames]
    x, y, _ = np.mean(winds, axis=0).tolist()
    return (x, y, 0.0)
