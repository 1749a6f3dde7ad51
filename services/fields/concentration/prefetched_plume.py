"""Prefetched plume: computes later frames while its readers wait."""

from collections import deque

from gslcosim.base.errors import ModelError
from gslcosim_services.fields.concentration.filament_field import round_to_single_precision
from gslcosim_services.fields.filament.downwash import Jets
from gslcosim_services.fields.filament.plume import FilamentPlume, Filaments

MAX_PREFETCHED_FRAMES = 64


class PrefetchedPlume:
    """Live plume with prefetched frames of its future; see `FilamentSource`.

    `prefetch` moves the plume and keeps what will be seen; `advance` then only takes the next frame. What is seen is
    the same to the bit, whenever and however often `prefetch` is called. An error of the plume is kept as a frame too,
    so that it is raised at the step in which it happens.

    Args:
        plume: What moves. Its wind must not depend on what happens in the run.
        step_s: Length of its steps [s].
        steps_per_frame: Frames are kept that many steps apart: a reader advances by as many.
    """

    def __init__(self, plume: FilamentPlume, *, step_s: float, steps_per_frame: int) -> None:
        self._plume = plume
        self._step_s = step_s
        self._steps_per_frame = steps_per_frame
        # The frame of now; none while the plume itself stands there.
        self._now: Filaments | None = None
        self._step = plume.step
        self._frames: deque[Filaments | ModelError] = deque()

    @property
    def step(self) -> int:
        """Number of steps made, as far as readers know."""
        return self._step

    @property
    def time_s(self) -> float:
        """Time since the sources opened [s]."""
        return self._step * self._step_s

    @property
    def filaments(self) -> Filaments:
        """The filaments now; the next step may overwrite them."""
        return self._plume.filaments if self._now is None else self._now

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        self._plume.reset(seed)
        self._now, self._step = None, 0
        self._frames.clear()

    def advance(self, n_steps: int = 1) -> None:
        """Go on by steps.

        Raises:
            ModelError: a filament is not finite, or the steps end between two frames that are kept.
        """
        while n_steps > 0 and self._frames:
            if n_steps < self._steps_per_frame:
                raise ModelError(f"gas: expected to advance by {self._steps_per_frame} steps, was {n_steps}.")
            frame = self._frames.popleft()
            if isinstance(frame, ModelError):
                raise frame
            self._now = frame
            self._step += self._steps_per_frame
            n_steps -= self._steps_per_frame
        if n_steps > 0:
            self._now = None
            self._step += n_steps
            self._plume.advance(n_steps)

    def blow(self, jets: Jets) -> None:
        """Carry filaments down in the jets of vehicles for one step.

        Raises:
            ModelError: the plume is ahead, so it is too late.
        """
        if self._frames or self._now is not None:
            raise ModelError("gas: expected no frame ahead of a jet.")
        self._plume.blow(jets)

    def prefetch(self) -> bool:
        """Prepare one more frame and return true, or return false where enough is prepared."""
        if len(self._frames) >= MAX_PREFETCHED_FRAMES or (self._frames and isinstance(self._frames[-1], ModelError)):
            return False
        if self._now is None:
            self._now = round_to_single_precision(self._plume.filaments)
        try:
            self._plume.advance(self._steps_per_frame)
        except ModelError as error:
            self._frames.append(error)
        else:
            self._frames.append(round_to_single_precision(self._plume.filaments))
        return True
