"""Search environment of Gymnasium: one agent's scenario run in this process, step by step."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from gslcosim.base.errors import UsageError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Environment
from gslcosim.environment.plan_view import PlanView
from gslcosim_formats.plan_pictures import PixelScale, PlanPainter
from gslcosim_search.learned.encoding import (
    WIND,
    WORLD,
    ActionKind,
    ObservationVector,
    action_kind,
    find_frame_problem,
    find_shield_problem,
    turn_actions,
)
from gslcosim_search.learned.shield import VelocityShield
from gslcosim_training import REMEDY
from gslcosim_training.path_lengths import PathLengths
from gslcosim_training.rewards import TIME_LIMIT, AgentState, Reward, TaskScale, reward_function
from gslcosim_training.stepped_run import LearningTask, SteppedRun

LONG_SIDE_PX = 480
_AIR, _SOLID, _BELOW = (255, 255, 255), (120, 120, 125), (222, 222, 226)
_INLET, _OUTLET = (76, 160, 255), (205, 130, 255)
_PATH, _VEHICLE, _SOURCE = (0, 114, 178), (213, 94, 0), (0, 158, 115)
_DOT_PX, _OPENING_PX = 6, 7
_MOST_SEED = 2**31


@dataclass
class MapImage:
    """Draws an agent over the plan of its room.

    Args:
        environment: The room.
        height_m: The height at which it is cut.
        sources_m: Where the sources are, world frame [m].
    """

    environment: Environment
    height_m: float
    sources_m: Sequence[Vec3]
    _path: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])

    def __post_init__(self) -> None:
        plan = PlanView.of(self.environment, self.height_m)
        self._scale = PixelScale.for_long_side(plan, LONG_SIDE_PX)
        painter = PlanPainter(plan, self._scale, _AIR)
        painter.cells(plan.below, _BELOW)
        painter.cells(plan.solid, _SOLID)
        painter.openings(_INLET, _OUTLET, width=_OPENING_PX)
        for source_m in self.sources_m:
            painter.dot(source_m, _DOT_PX, fill=_SOURCE)
        self._plan = painter.image

    def move_to(self, position_m: Vec3) -> None:
        """Take note of where the agent is, world frame [m]."""
        self._path.append(self._scale.pixel(position_m))

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture, (height, width, 3), y upwards as on a map."""
        picture = self._plan.copy()
        draw = ImageDraw.Draw(picture)
        if len(self._path) > 1:
            draw.line(self._path, fill=_PATH, width=2)
        if self._path:
            draw.circle(self._path[-1], _DOT_PX, fill=_VEHICLE)
        return np.asarray(picture)


try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:  # an extra
    raise UsageError(f"gymnasium: expected the package, found none. Install it with: {REMEDY}") from error


class SearchEnv(gymnasium.Env[NDArray[np.float32], Any]):
    """A scenario with one agent, whose commands are the actions.

    A step lasts from one question to the next: to the end of a leg and its hold with `mode: on_request`, a tick with
    `mode: lockstep`. It is the flight that `gslcosim up` makes of the same commands, to the bit; `info["digest"]` has
    the run's digest after the last step.

    Observations are vectors in [-1, 1]; `observation_names` says what each number is. `info` has the referee's figures:
    `distance_to_source_m`, `path_length_m`, `n_commands`, `time_s`, and after the last step `outcome`, `success` and
    `digest`. A search that ends at its time limit is truncated; every other end terminates it.

    Args:
        scenario: A file, or the name of a bundled scenario.
        overrides: Values to replace, such as `agents[0].mode=lockstep`.
        action: `waypoint`, `waypoint_3d`, `velocity`, `velocity_3d`, `drive` (vectors in [-1, 1]), or `heading`, one of
            eight directions, or to hold.
        step_m: The longest leg [m].
        speed_m_s: The highest speed of velocities and drives [m/s].
        hold_s: How long a waypoint is held and a velocity kept [s]; absent: as the scenario says.
        reward: `sparse`, `potential`, or a function of the moments before and after a step and their scale.
        discount: Of the shaping of `potential`.
        frame: `world`, or `wind`: velocities and waypoints are then upwind and to the left of it.
        has_wind_frame: Whether observations have the numbers of `wind_frame` too.
        shield_m: The distance that velocities keep from what range finders see [m]; absent: no shield.
        render_mode: `rgb_array` for a picture of the map.

    Raises:
        UsageError: an argument is not one of those, or the scenario has several agents.
        ScenarioError: the scenario has problems.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        scenario: str | Path = "warehouse_empty",
        *,
        overrides: Sequence[str] = (),
        action: str = "waypoint",
        step_m: float = 1.0,
        speed_m_s: float = 1.0,
        hold_s: float | None = None,
        reward: str | Reward = "potential",
        discount: float = 0.99,
        frame: str = WORLD,
        has_wind_frame: bool = False,
        shield_m: float | None = None,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise UsageError(f"render_mode: expected rgb_array or None, was {render_mode!r}.")
        if (problem := find_frame_problem(action, frame)) is not None:
            raise UsageError(f"frame: {problem}")
        self.render_mode = render_mode
        if (problem := find_shield_problem(action, shield_m)) is not None:
            raise UsageError(f"shield_m: {problem}")
        self._shield_m = shield_m
        self._is_turned, self._has_wind_frame = frame == WIND, has_wind_frame or frame == WIND
        self._task = LearningTask(scenario=scenario, overrides=tuple(overrides))
        self._action_settings = {"step_m": step_m, "speed_m_s": speed_m_s, "hold_s": hold_s}
        self._action_name = action
        self._reward = reward_function(reward)
        self._discount = discount
        # A first search tells what there is to see; the first reset begins another.
        search = self._begun(seed=0)
        search.flight.close()
        self.observation_names: tuple[str, ...] = search.vector.names
        self.observation_space = spaces.Box(-1.0, 1.0, (search.vector.size,), np.float32)
        self.action_space = build_action_space(search.actions)
        self._search: _Search | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a search; `seed` is the scenario's seed, without which the next is drawn; `options` has no meaning.

        Raises:
            UsageError: there are options.
        """
        if options:
            raise UsageError(f"reset: options: expected none, was {', '.join(options)}.")
        super().reset(seed=seed)
        self.close()
        drawn = int(self.np_random.integers(_MOST_SEED)) if seed is None else seed % _MOST_SEED
        search = self._search = self._begun(drawn)
        return search.seen(), search.info()

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Give a command and fly on until the next is asked for, or to the end; see the class."""
        search = self._search
        if search is None or search.flight.is_over:
            raise UsageError("No search is active. Call reset before step.")
        before = search.moment()
        search.act(action)
        after = search.moment()
        is_truncated = after.outcome == TIME_LIMIT
        is_terminated = search.flight.is_over and not is_truncated
        return search.seen(), self._reward(before, after, search.scale), is_terminated, is_truncated, search.info()

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Return the map with the way so far, (height, width, 3); None without `render_mode`."""
        if self.render_mode != "rgb_array" or self._search is None:
            return None
        return self._search.drawing.pixels()

    def close(self) -> None:
        """End the search that goes on, if one does."""
        search, self._search = self._search, None
        if search is not None:
            search.flight.close()

    def _begun(self, seed: int) -> "_Search":
        loaded = self._task.loaded(seed)
        scenario = loaded.scenario
        if len(scenario.agents) != 1:
            raise UsageError(
                f"scenario: expected one agent, was {len(scenario.agents)} in {scenario.name}. "
                "gslcosim_training.parallel_env is for several."
            )
        flight = SteppedRun(loaded)
        briefing = flight.get_briefing(scenario.agents[0].name)
        sources_m = [source.position_m for source in scenario.gas.searched]
        vector, shield = ObservationVector(briefing, has_wind_frame=self._has_wind_frame), None
        if self._shield_m is not None:
            hold_s, speed_m_s = self._action_settings["hold_s"], self._action_settings["speed_m_s"]
            shield = VelocityShield(
                briefing, vector.names, keep_m=self._shield_m, speed_m_s=speed_m_s or 0.0, hold_s=hold_s
            )
        return _Search(
            agent=briefing.agent,
            flight=flight,
            vector=vector,
            shield=shield,
            is_turned=self._is_turned,
            actions=action_kind(self._action_name, briefing, **self._action_settings),
            scale=flight.scale(self._discount),
            drawing=MapImage(flight.environment, briefing.search_height_m, sources_m),
            lengths=flight.path_lengths(self._action_name)[briefing.agent],
        )


@dataclass
class _Search:
    """One flight with what turns its messages into numbers, and numbers into commands."""

    agent: str
    flight: SteppedRun
    vector: ObservationVector
    actions: ActionKind
    scale: TaskScale
    drawing: MapImage
    lengths: PathLengths
    is_turned: bool
    shield: VelocityShield | None
    numbers: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))

    def act(self, action: Any) -> None:
        if self.is_turned:
            action = turn_actions(np.asarray(action)[None, :], [self.vector.upwind])[0]
        if self.shield is not None:
            action = self.shield.shielded(action, self.numbers)
        self.flight.command(self.agent, self.actions.command(self.flight.seen_by(self.agent), action))
        self.flight.go_on()

    def seen(self) -> NDArray[np.float32]:
        observation = self.flight.seen_by(self.agent)
        self.drawing.move_to(observation.position_world_m)
        self.numbers = self.vector.of(observation)
        return self.numbers.copy()

    def moment(self) -> AgentState:
        score = self.flight.scores[self.agent]
        return AgentState(
            distance_m=score.distance_to_source_m,
            time_s=self.flight.seen_by(self.agent).time_s,
            n_commands=score.n_commands,
            outcome=self.flight.outcome_of(self.agent),
            path_m=self.flight.path_m(self.agent, self.lengths),
        )

    def info(self) -> dict[str, Any]:
        score = self.flight.scores[self.agent]
        return {
            "distance_to_source_m": score.distance_to_source_m,
            "path_length_m": score.path_length_m,
            "n_commands": score.n_commands,
            "time_s": self.flight.seen_by(self.agent).time_s,
            **self.flight.end_of(self.agent),
        }


def build_action_space(actions: ActionKind) -> "spaces.Space[Any]":
    """Return the space of one kind of actions."""
    if actions.n_choices:
        return spaces.Discrete(actions.n_choices)
    return spaces.Box(-1.0, 1.0, (actions.n_numbers,), np.float32)
