"""A battery, exported as an FMU of FMI 3 by pythonfmu3: a vehicle draws more from it the faster it is."""

from math import hypot

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability, Unit


class Battery(Fmi3Slave):
    """Battery that hovering and speed discharge."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__(**kwargs)
        self.register_units([Unit("m/s", m=1, s=-1), Unit("W", kg=1, m=2, s=-3), Unit("J", kg=1, m=2, s=-2)])
        self.time, self.x_m_s, self.y_m_s = 0.0, 0.0, 0.0
        self.capacity_j, self.hover_w, self.used_j, self.charge = 250_000.0, 180.0, 0.0, 1.0
        continuous, fixed = Fmi3Variability.continuous, Fmi3Variability.fixed
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=continuous))
        self.register_variable(Float64("x_m_s", causality=Fmi3Causality.input, unit="m/s"))
        self.register_variable(Float64("y_m_s", causality=Fmi3Causality.input, unit="m/s"))
        self.register_variable(Float64("capacity_j", causality=Fmi3Causality.parameter, variability=fixed, unit="J"))
        self.register_variable(Float64("hover_w", causality=Fmi3Causality.parameter, variability=fixed, unit="W"))
        self.register_variable(Float64("used_j", causality=Fmi3Causality.output, unit="J"))
        self.register_variable(Float64("charge", causality=Fmi3Causality.output))

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Step to the time `current_time + step_size` [s]."""
        self.time = current_time + step_size
        self.used_j += step_size * (self.hover_w + 12.0 * hypot(self.x_m_s, self.y_m_s) ** 2)
        self.charge = 1.0 - self.used_j / self.capacity_j
        return True
