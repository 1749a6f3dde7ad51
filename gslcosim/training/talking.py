"""Numbers that agents tell each other by radio, as texts that travel on a channel of the scenario."""

import json
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Briefing, Observation, RadioMessage
from gslcosim.errors import UsageError

_DECIMALS = 3


class RadioNumbers:
    """What one agent tells all others, and what it has heard of each of them last: numbers between -1 and 1.

    They travel on the first channel that the briefing names, with its range, losses and delay.

    Args:
        briefing: Of the agent.
        n_numbers: How many numbers an agent tells.

    Raises:
        UsageError: the agent has no channel.
    """

    def __init__(self, briefing: Briefing, n_numbers: int) -> None:
        if n_numbers and not briefing.channels:
            raise UsageError(
                f"radio_numbers: expected 0 for {briefing.agent}, which has no channel, was {n_numbers}. Add one to "
                "channels of the scenario."
            )
        self.n_numbers = n_numbers
        self._channel = briefing.channels[0].name if n_numbers else ""
        members = briefing.channels[0].members if n_numbers else ()
        self.others = tuple(name for name in members if name != briefing.agent)
        self._heard = {name: [0.0] * n_numbers for name in self.others}

    @property
    def size(self) -> int:
        """How many numbers are heard."""
        return self.n_numbers * len(self.others)

    def message(self, numbers: Sequence[float]) -> tuple[RadioMessage, ...]:
        """Return the text that tells numbers."""
        if not self.n_numbers:
            return ()
        text = json.dumps([round(float(number), _DECIMALS) for number in numbers])
        return (RadioMessage(channel=self._channel, text=text),)

    def hear(self, observation: Observation) -> NDArray[np.float32]:
        """Take note of what came, and return what each of `others` has told last, (size,); 0 before the first.

        A text comes with one observation only, so each has to be heard.
        """
        for reception in observation.incoming:
            if reception.sender in self._heard and (numbers := _numbers_of(reception.text, self.n_numbers)):
                self._heard[reception.sender] = numbers
        return np.array([number for name in self.others for number in self._heard[name]], dtype=np.float32)


# Others may speak on the channel too.
def _numbers_of(text: str, n_numbers: int) -> list[float] | None:
    try:
        numbers = [float(number) for number in json.loads(text)]
    except (ValueError, TypeError):
        return None
    if len(numbers) != n_numbers or not all(math.isfinite(number) for number in numbers):
        return None
    return [min(max(number, -1.0), 1.0) for number in numbers]
