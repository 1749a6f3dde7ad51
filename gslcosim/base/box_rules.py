"""Rules of boxes in users' files, as validators' errors for corners that do not fit together."""

from pydantic_core import PydanticCustomError

from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3


def format_point(numbers: Vec3) -> str:
    """Return three numbers in the notation of scenario files."""
    return f"[{', '.join(f'{number:g}' for number in numbers)}]"


def check_box(min_m: Vec3, max_m: Vec3) -> None:
    """Raise a validator's error unless two points are the lower and upper corner of a box [m]."""
    if min(measure_sides_m(min_m, max_m)) <= 0:
        raise build_corner_error(
            max_m,
            f"each number greater than that of min_m, {format_point(min_m)}",
            "min_m and max_m are opposite corners.",
        )


def check_rectangle(min_m: Vec3, max_m: Vec3) -> None:
    """Raise a validator's error unless two points span a rectangle: a box that is flat along exactly one axis."""
    sides_m = measure_sides_m(min_m, max_m)
    if min(sides_m) != 0 or sides_m.count(0) != 1:
        raise build_corner_error(
            max_m,
            f"one number equal to that of min_m, {format_point(min_m)}, and two greater",
            "An opening is a rectangle on one side of the room.",
        )


def check_velocity_of(kind: str, velocity_m_s: Vec3 | None) -> None:
    """Raise a validator's error if an opening other than an inlet has a velocity."""
    if velocity_m_s is not None and kind != "inlet":
        raise broken_rule_error(
            key="velocity_m_s",
            expected=f"no velocity for an {'open side' if kind == 'open' else kind}",
            found=format_point(velocity_m_s),
            remedy="Only an inlet has one; the air finds its way through the others.",
        )


def build_corner_error(max_m: Vec3, expected: str, remedy: str) -> PydanticCustomError:
    """Return the error of a second corner that does not fit the first."""
    return broken_rule_error(key="max_m", expected=expected, found=format_point(max_m), remedy=remedy)


def measure_sides_m(min_m: Vec3, max_m: Vec3) -> list[float]:
    """Return the lengths of a box along the axes [m]; negative where its corners are in the wrong order."""
    return [high - low for low, high in zip(min_m, max_m, strict=True)]
