"""A controller of a fan, exported as an FMU of FMI 3 by pythonfmu3: it turns the fan up while there is gas."""

from math import exp

from pythonfmu3 import Boolean, Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability, Unit


class FanController(Fmi3Slave):
    """Fan whose share of its usual speed follows the gas with a time constant."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__(**kwargs)
        self.register_units([Unit("ppm"), Unit("s", s=1)])
        self.time, self.gas_ppm, self.above_ppm, self.full_share, self.ramp_s = 0.0, 0.0, 1.0, 3.0, 2.0
        self.share, self.is_on = 1.0, False
        continuous, fixed = Fmi3Variability.continuous, Fmi3Variability.fixed
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=continuous))
        self.register_variable(Float64("gas_ppm", causality=Fmi3Causality.input, unit="ppm"))
        self.register_variable(Float64("above_ppm", causality=Fmi3Causality.parameter, variability=fixed, unit="ppm"))
        self.register_variable(Float64("full_share", causality=Fmi3Causality.parameter, variability=fixed))
        self.register_variable(Float64("ramp_s", causality=Fmi3Causality.parameter, variability=fixed, unit="s"))
        self.register_variable(Float64("share", causality=Fmi3Causality.output))
        self.register_variable(Boolean("is_on", causality=Fmi3Causality.output, variability=Fmi3Variability.discrete))

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Step to the time `current_time + step_size` [s]."""
        self.time = current_time + step_size
        self.is_on = self.gas_ppm > self.above_ppm
        wanted = self.full_share if self.is_on else 1.0
        self.share += (wanted - self.share) * (1.0 - exp(-step_size / self.ramp_s))
        return True
