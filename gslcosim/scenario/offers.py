"""What installed packages offer to gslcosim by entry points, imported when a scenario names it and not before."""

from importlib.metadata import EntryPoint, entry_points

from pydantic_core import PydanticCustomError

from gslcosim.scenario.models.rules import broken_rule


def names_offered(group: str) -> tuple[str, ...]:
    """Return the names under which packages offer something in a group of entry points, in alphabetical order."""
    return tuple(sorted(entry_points(group=group).names))


def import_offered(group: str, name: str, *, kind: str, key: str) -> tuple[EntryPoint, object]:
    """Return what a package offers under a name, with the entry point that says where it is.

    Args:
        group: The group of entry points.
        name: One of `names_offered`.
        kind: What it should be, for the text of the error: `the criterion 'stay'`.
        key: The key of the block that names it, for the place of the error.

    Raises:
        PydanticCustomError: it cannot be imported.
    """
    point = entry_points(group=group)[name]
    try:
        return point, point.load()
    # A package of somebody else may raise anything when it is imported.
    except Exception as error:
        raise broken_rule(
            key=key,
            expected=f"{point.value} to be imported for {kind}",
            found=repr(error),
            remedy="Correct the package.",
        ) from error


def not_what_is_offered(point: EntryPoint, found: object, *, expected: str, key: str) -> PydanticCustomError:
    """Return the error that says that what a package offers is something else than its kind."""
    return broken_rule(
        key=key,
        expected=f"{point.value} to be {expected}",
        found=f"{found!s:.60}",
        remedy="Correct the entry point of the package.",
    )
