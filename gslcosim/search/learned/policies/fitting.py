"""Which numbers of an agent's observation a policy observes."""

from collections.abc import Sequence

from gslcosim.search.learned.policies.policy import Policy, PolicyError


def places_of(policy: Policy, offered: Sequence[str]) -> list[int]:
    """Return the place of each observation of a policy among those that an agent has.

    A scenario names its sensors as it likes: a number of a sensor whose name is not there is that of the only sensor
    that tells a number of this kind, `nose.amount` for example that of a PID with the name `pid`.

    Args:
        policy: The policy.
        offered: `ObservationVector.names` of the agent.

    Raises:
        PolicyError: an observation is not there, or several sensors could be meant.
    """
    places = [_place_of(name, offered) for name in policy.observation_names]
    missing = [name for name, place in zip(policy.observation_names, places) if place is None]
    if missing:
        used = set(places)
        others = [name for i, name in enumerate(offered) if i not in used]
        raise PolicyError(
            f"observations: expected {', '.join(missing)} for this policy, was missing; not used are "
            f"{', '.join(others) or 'none'}. Give the agent sensors that tell it, by these names."
        )
    return [place for place in places if place is not None]


def _place_of(name: str, offered: Sequence[str]) -> int | None:
    if name in offered:
        return offered.index(name)
    _, dot, number = name.rpartition(".")
    like = [i for i, other in enumerate(offered) if other.rpartition(".")[1:] == (dot, number)]
    return like[0] if dot and len(like) == 1 else None
