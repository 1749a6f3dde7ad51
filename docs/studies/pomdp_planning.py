"""Planning under uncertainty for `train_qmdp.py`: value iteration, which is QMDP, and Perseus.

States are cells, moves lead from cell to cell for sure, what is observed depends on the cell that was reached. A state
may be terminal: there the search is over, and the searcher knows it. Values are discounted sums of rewards.

Held by:
    extensions/search/tests/unit/information/test_pomdp.py (corridor and tiger solved by hand, three steps of backups;
    values of Perseus never fall, and are never above a searcher's that sees)
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.information.pomdp import MOVES, OffsetGrid

Floats = NDArray[np.float64]


def find_successors(grid: OffsetGrid) -> NDArray[np.int64]:
    """Return the (4, n_cells) cells that `MOVES` lead to; at the edge a move leads nowhere."""
    i, j = np.divmod(np.arange(grid.n_cells), grid.shape[1])
    return np.array(
        [
            np.clip(i + di, 0, grid.shape[0] - 1) * grid.shape[1] + np.clip(j + dj, 0, grid.shape[1] - 1)
            for di, dj in MOVES
        ]
    )


@dataclass(frozen=True, kw_only=True)
class Pomdp:
    """A decision problem with deterministic moves and noisy observations.

    `successor` is (n_actions, n_states): the state that an action leads to; `observed` (n_levels, n_states): the
    probability of each observation in the state that was reached, columns sum to 1; `reward` (n_actions, n_states): of
    an action in a state; `is_terminal` (n_states,): where the search is over; `discount` in (0, 1).
    """

    successor: NDArray[np.int64]
    observed: Floats
    reward: Floats
    is_terminal: NDArray[np.bool_]
    discount: float

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.successor.shape[0]

    @property
    def n_states(self) -> int:
        """Number of states."""
        return self.successor.shape[1]


def solve_by_value_iteration(problem: Pomdp, *, tolerance: float = 1e-9, max_sweeps: int = 100_000) -> Floats:
    """Return the value of each action in each state, for a searcher that sees its state.

    Q(a, s) = r(a, s) + g V(s'),   V(s) = max over a of Q(a, s),   V = 0 where the search is over
    [reward] = [reward]; g the discount, s' the state that a leads to from s.

    Args:
        problem: The problem; its observations play no part.
        tolerance: Sweeps end when no value changes by more than this [reward].
        max_sweeps: More than enough: the error falls by the discount with each.

    Returns:
        (n_actions, n_states) Q; 0 in terminal states.

    Source:
        Bellman 1957, Dynamic programming; Littman, Cassandra, Kaelbling 1995 for its use as QMDP.
    """
    is_open = ~problem.is_terminal
    value = np.zeros(problem.n_states)
    q = np.zeros(problem.successor.shape)
    for _ in range(max_sweeps):
        q = (problem.reward + problem.discount * value[problem.successor]) * is_open
        newer = q.max(axis=0)
        change = float(np.abs(newer - value).max())
        value = newer
        if change <= tolerance:
            break
    return q


def predict_belief(belief: Floats, problem: Pomdp, action: int) -> Floats:
    """Return a belief after an action and before its observation: (n_states,), sum as before.

    p'(s') = sum over s with s' = successor(a, s) of p(s)
    """
    return np.bincount(problem.successor[action], weights=belief, minlength=problem.n_states).astype(np.float64)


def update_belief(belief: Floats, problem: Pomdp, action: int, level: int) -> tuple[Floats, float]:
    """Return the belief after an action and an observation, the search not being over, and how probable that was.

    p(s' | a, o) = P(o | s') p'(s') / sum,   p' moved, 0 where the search would be over

    Args:
        belief: (n_states,) probability of each state, sum 1.

    Returns:
        belief: (n_states,), sum 1; all 0 when the observation was impossible.
        probability: Of this observation and of going on, given the belief and the action.

    Source:
        Åström 1965; Kaelbling, Littman, Cassandra 1998, doi:10.1016/S0004-3702(98)00023-X, eq. 1.
    """
    joint = predict_belief(belief, problem, action) * problem.observed[level] * ~problem.is_terminal
    probability = float(joint.sum())
    return (joint / probability if probability > 0.0 else joint), probability


def backup_at_belief(belief: Floats, problem: Pomdp, vectors: Floats) -> tuple[Floats, int]:
    """Return the best linear function of beliefs that one more step of planning gives at a belief, and its action.

    a_new(s) = r(a, s) + g sum over o of P(o | s') a_o(s'),   a_o = argmax over vectors of sum_s' a(s') P(o | s') p'(s')
    for the action a whose a_new . p is greatest; terms of terminal s' and all values in terminal s are 0.

    Args:
        belief: (n_states,) p.
        vectors: (n_vectors, n_states) linear functions whose greatest is the value so far.

    Returns:
        (n_states,) vector [reward] and its action.

    Source:
        Pineau, Gordon, Thrun 2003, Point-based value iteration, IJCAI.
    Deviation:
        Moves are deterministic, so sums over successors are look-ups.
    """
    best: tuple[float, Floats, int] | None = None
    goes_on = ~problem.is_terminal
    for action in range(problem.n_actions):
        reached = predict_belief(belief, problem, action) * goes_on
        chosen = [vectors[int(np.argmax(vectors @ (seen * reached)))] for seen in problem.observed]
        ahead = sum(seen * vector for seen, vector in zip(problem.observed, chosen, strict=True)) * goes_on
        vector = (problem.reward[action] + problem.discount * ahead[problem.successor[action]]) * goes_on
        value = float(vector @ belief)
        if best is None or value > best[0]:
            best = value, vector, action
    assert best is not None
    return best[1], best[2]


def improve_by_perseus(
    problem: Pomdp,
    beliefs: Floats,
    vectors: Floats,
    actions: NDArray[np.int64],
    rng: np.random.Generator,
) -> tuple[Floats, NDArray[np.int64]]:
    """Return linear functions whose greatest is nowhere worse at the beliefs than before: one stage of Perseus.

    Beliefs are drawn among those that are not yet as good as before; each is backed up, and keeps its old vector where
    that is better.

    Args:
        beliefs: (n_beliefs, n_states) where the value is to be improved.
        vectors: (n_vectors, n_states) so far: a lower bound of the value.
        actions: (n_vectors,) the action of each.
        rng: Draws the order.

    Returns:
        (m, n_states) vectors and (m,) their actions.

    Source:
        Spaan, Vlassis 2005, Perseus, doi:10.1613/jair.1659.
    """
    scores = beliefs @ vectors.T
    before, holder = scores.max(axis=1), scores.argmax(axis=1)
    now = np.full(len(beliefs), -np.inf)
    kept: list[tuple[Floats, int]] = []
    while len(behind := np.flatnonzero(now < before - 1e-12)):
        i = int(rng.choice(behind))
        vector, action = backup_at_belief(beliefs[i], problem, vectors)
        if vector @ beliefs[i] < before[i]:
            vector, action = vectors[holder[i]], int(actions[holder[i]])
        kept.append((vector, action))
        now = np.maximum(now, beliefs @ vector)
    return np.array([vector for vector, _ in kept]), np.array([action for _, action in kept], np.int64)


def sample_beliefs(
    problem: Pomdp,
    start_of: Callable[[np.random.Generator], Floats],
    q: Floats,
    rng: np.random.Generator,
    *,
    n_beliefs: int,
    n_steps: int,
    exploring_frac: float = 0.3,
) -> Floats:
    """Return beliefs that a searcher meets which mostly takes the action of the greatest expected Q.

    Args:
        start_of: Draws the belief with which a search begins, sum 1.
        q: (n_actions, n_states) of `solve_by_value_iteration`.
        rng: Draws states, observations and random moves.
        exploring_frac: Share of random moves.

    Returns:
        (n_beliefs, n_states).
    """
    found: list[Floats] = []
    while len(found) < n_beliefs:
        belief = start_of(rng)
        state = int(rng.choice(problem.n_states, p=belief))
        for _ in range(n_steps):
            if len(found) == n_beliefs or problem.is_terminal[state]:
                break
            found.append(belief)
            is_random = rng.random() < exploring_frac
            action = int(rng.integers(problem.n_actions)) if is_random else int(np.argmax(q @ belief))
            state = int(problem.successor[action, state])
            level = int(rng.choice(len(problem.observed), p=problem.observed[:, state]))
            belief, probability = update_belief(belief, problem, action, level)
            if probability == 0.0:
                break
    return np.array(found)
