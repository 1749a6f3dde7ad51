"""What an agent believes: a picture over the map, and how good it is by the truth."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gslcosim.contract.messages import Belief, BeliefScore
from gslcosim.recording import colors
from gslcosim.recording.entities import AgentEntities
from gslcosim.recording.rows.columns import ScalarRows
from gslcosim.recording.run_file import RunFile
from gslcosim.recording.scene import picture_format, slice_height_m


class BeliefPictureRows:
    """A belief as a picture at its height: brightest in the most probable cell, by the square root of the probability.

    A belief in space is drawn as its sum over the height.
    """

    def __init__(self, entity: str, height_m: float) -> None:
        self._entity = entity
        self._height_m = height_m
        self._colors = colors.belief_colors()
        self._ticks: list[int] = []
        self._beliefs: list[Belief] = []

    def add(self, tick: int, belief: Belief) -> None:
        """Append a belief at a tick."""
        self._ticks.append(tick)
        self._beliefs.append(belief)

    def send(self, file: RunFile) -> None:
        """Write the waiting beliefs, if any, and forget them."""
        for tick, belief in zip(self._ticks, self._beliefs, strict=True):
            p = in_plane(belief)
            file.send(
                self._entity,
                [tick],
                rr.GridMap.columns(
                    data=[self._picture(p)],
                    format=[picture_format(*p.shape)],
                    cell_size=[belief.cell_m],
                    translation=[(*belief.origin_m[:2], slice_height_m(self._height_m))],
                ),
            )
        self._ticks, self._beliefs = [], []

    # Rows of a picture run from the far side (largest y) to the near one.
    def _picture(self, p: NDArray[np.float64]) -> bytes:
        levels = (np.sqrt(p / p.max()) * (colors.N_LEVELS - 1)).astype(np.uint8)
        return self._colors[levels.T[::-1]].tobytes()


class BeliefRows:
    """All rows of what one agent believes."""

    def __init__(self, names: AgentEntities) -> None:
        self._names = names
        self.picture = BeliefPictureRows(names.belief, names.agent.vehicle.search_height_m)
        self.mass_near = ScalarRows(names.belief_mass)
        self.expected_distance = ScalarRows(names.belief_distance)
        self.has_any = False
        self._last: BeliefScore | None = None

    def all(self) -> tuple[BeliefPictureRows, ScalarRows, ScalarRows]:
        """Return the rows of every entity."""
        return self.picture, self.mass_near, self.expected_distance

    def note_belief(self, tick: int, belief: Belief) -> None:
        """Take note of what the agent has published."""
        self.has_any = True
        self.picture.add(tick, belief)

    def note_score(self, tick: int, score: BeliefScore | None) -> None:
        """Take note of how good its last belief is, where that is news."""
        if score is not None and score != self._last:
            self.mass_near.add(tick, score.mass_near_frac)
            self.expected_distance.add(tick, score.expected_distance_m)
            self._last = score

    def draw(self, file: RunFile, *, label: str) -> None:
        """Say how the curves look; `label` precedes their names."""
        names = self._names
        styles = {names.belief_mass: "belief near the source", names.belief_distance: "expected by belief"}
        for entity, text in styles.items():
            shade = colors.plan_color(names.color)
            file.draw(entity, rr.SeriesLines(names=[f"{label}{text}"], colors=[shade], widths=[1.5]))


def in_plane(belief: Belief) -> NDArray[np.float64]:
    """Return the (nx, ny) probabilities of a belief, summed over the height where it is in space."""
    p = belief.probability.to_array().astype(np.float64)
    return p.sum(axis=2) if p.ndim == 3 else p
