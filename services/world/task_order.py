"""Decisions of an autopilot: the fate of a task, the event a tick is watched for, the ticks at which the agent is due.

These are scalar kernels, which `autopilot` calls for one vehicle, and batches of searches for many.
"""

# ruff: noqa: FBT001 - kernels

from gslcosim.base.scalar_kernels import scalar_kernel

# Fates of a task.
REFUSE, STOP, DEFER, DROP, RISE, ACCEPT = range(6)

# Events that a tick is watched for.
NOTHING, PREPARATION, EDGE, ARRIVAL = range(4)


@scalar_kernel
def find_answer(is_refused: bool, is_hold: bool, is_taking_off: bool, has_to_rise: bool) -> int:
    """Return the fate of a new task: REFUSE, STOP, DEFER, RISE or ACCEPT.

    A task that is refused and one to hold both stop the vehicle, and drop a task that was deferred.

    Args:
        is_refused: The vehicle cannot do it.
        is_hold: The task is to hold.
        is_taking_off: The vehicle takes off, which it always finishes.
        has_to_rise: It stands on the ground, and the task begins in the air.
    """
    if is_refused:
        return REFUSE
    if is_hold:
        return STOP
    if is_taking_off:
        return DEFER
    return RISE if has_to_rise else ACCEPT


@scalar_kernel
def find_deferred_answer(is_taking_off: bool, is_holding: bool) -> int:
    """Return the fate of a deferred task at the end of a tick: DEFER, ACCEPT, or DROP after another event.

    Args:
        is_taking_off: The vehicle takes off.
        is_holding: It holds.
    """
    if is_taking_off:
        return DEFER
    return ACCEPT if is_holding else DROP


@scalar_kernel
def find_watch(is_preparing: bool, is_continuous: bool, is_under_way: bool) -> int:
    """Return the event to watch for at the end of a tick: PREPARATION, EDGE, ARRIVAL or NOTHING.

    Args:
        is_preparing: The path only prepares for the task, which starts after it.
        is_continuous: The motion has no end of its own, so that the room's may come first.
        is_under_way: The vehicle goes to a place.
    """
    if is_preparing:
        return PREPARATION
    if is_continuous:
        return EDGE
    return ARRIVAL if is_under_way else NOTHING


@scalar_kernel
def is_command_due(
    is_every_tick: bool, is_failed: bool, is_idle: bool, is_continuous: bool, tick: int, hold_until_tick: int
) -> bool:
    """Return whether the agent is due for a command at the end of a tick.

    Args:
        is_every_tick: The agent is due at every tick.
        is_failed: The vehicle has stopped for good.
        is_idle: The vehicle holds or stands, with nothing ahead.
        is_continuous: Its motion has no end of its own.
        tick: The tick that ends.
        hold_until_tick: The tick until which it holds, or keeps a velocity.
    """
    if is_every_tick:
        return not is_failed
    return (is_idle or is_continuous) and tick >= hold_until_tick
