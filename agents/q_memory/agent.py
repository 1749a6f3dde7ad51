"""Q-memory: steps up, down or across the wind by what a learned table says of the last seconds of gas.

After Rando, James, Verri, Rosasco, Seminara 2025. README.md beside this file has the rules.
"""

import math
from pathlib import Path

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search import elementary
from gslcosim_search.reactive.reactive_searcher import ReactiveAgent
from gslcosim_search.reactive.silkmoth import TrueWind
from gslcosim_search.reactive.temporal_memory import (
    N_GAS_STATES,
    STEPS,
    Recovery,
    TemporalMemory,
    best_move,
    load_policies,
    make_recovery,
)
from gslcosim_search.senses.hit_detection import GasHits
from gslcosim_search.senses.instruments import find_noses, find_vane
from gslcosim_search.senses.stop_and_measure import Contact

POLICIES = Path(__file__).with_name("policies.json")


class QMemory(ReactiveAgent):
    """Remembers the last seconds of gas, its moves since the last gas, and how a recovery goes on."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        s = self.settings
        self.nose = find_noses(briefing)[0]
        self.hits = GasHits(self.nose, threshold_ppm=s.threshold_ppm)
        self.wind = TrueWind(find_vane(briefing), smoothing_s=s.wind_s, threshold_m_s=s.threshold_m_s)
        self.memory = TemporalMemory(
            noise=s.threshold_ppm, first_s=s.memory_s, least_s=s.least_memory_s, most_s=s.most_memory_s, adapts=s.adapts
        )
        self.table = load_policies(POLICIES)[s.recovery]
        self.moves: list[int] = []  # since the last gas
        self.recovery: Recovery | None = None
        self.hit_s = -math.inf

    def observe(self, observation: Observation) -> None:
        """Take note of gas and wind at every tick; a MOX sensor counts while it meets gas, not while it recovers."""
        super().observe(observation)
        self.wind.add(observation)
        is_hit = self.hits.add(observation)
        if self.nose.is_ready(observation):
            amount = self.nose.amount(observation) if self.nose.unit != "ohm" else float(is_hit)
            self.memory.add(observation.time_s, amount)
        if is_hit and observation.time_s > self.hit_s:
            self.hit_s = observation.time_s
            self.moves.clear()

    @property
    def may_abort(self) -> bool:
        """True if gas ends a leg that is under way."""
        return math.isinf(self.hit_s)

    def next_step(self, observation: Observation, contact: Contact) -> Command:
        """Return the next step, or a leg of the exploration before there was gas and long after."""
        is_void_long = observation.time_s - self.hit_s > self.settings.give_up_s
        if self.wind.upwind_rad is None or is_void_long or self.is_away:
            self.recovery, self.memory.n_void = None, 0
            return self.explore(observation)
        move = self.next_move(self.memory.decide(observation.time_s))
        self.moves.append(move)
        ahead, left = STEPS[move]
        heading_rad = self.wind.upwind_rad + elementary.atan2(float(left), float(ahead))
        x_m, y_m, _ = observation.position_world_m
        step_m = self.settings.step_m
        return self.fly_to(
            observation, (x_m + step_m * elementary.cos(heading_rad), y_m + step_m * elementary.sin(heading_rad))
        )

    def next_move(self, state: int) -> int:
        """Return the table's move; in the void that of a recovery, unless the void was learned too."""
        if state < N_GAS_STATES or self.settings.recovery == "learned":
            self.recovery = None
            return best_move(self.table[state])
        if self.recovery is None:
            self.recovery = make_recovery(self.settings.recovery, self.draws, self.moves)
        return self.recovery.next_move()


if __name__ == "__main__":
    run(QMemory)
