"""Row filters as people write them: `outcome=collision`, `time_s>=60`."""

import fnmatch
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from gslcosim.base.errors import UsageError

_FORM = re.compile(r"\s*([^\s!<>=]+)\s*(!=|<=|>=|=|<|>)\s*(.*?)\s*", re.DOTALL)
_ORDERS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
Row = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One condition; a row without a value in the column meets only `!=`."""

    column: str
    relation: str
    value: str | float

    @classmethod
    def of(
        cls, text: str, *, numbers: Sequence[str], texts: Sequence[str], short: Mapping[str, str] | None = None
    ) -> Self:
        """Read a condition on columns of numbers and of texts; `short` has other names of columns.

        Raises:
            UsageError: it has another form, its column is none of these, or its value does not fit the column.
        """
        match = _FORM.fullmatch(text)
        if match is None:
            raise UsageError(f"--where: expected COLUMN=VALUE, or !=, <, <=, > or >= for =, was '{text}'.")
        column, relation, value = match.groups()
        column = (short or {}).get(column, column)
        check_column("--where", column, (*texts, *numbers))
        if column in texts:
            if relation in _ORDERS:
                raise UsageError(f"--where {text}: expected = or != for the texts of {column}, was {relation}.")
            return cls(column=column, relation=relation, value=value)
        try:
            return cls(column=column, relation=relation, value=float(value))
        except ValueError as error:
            raise UsageError(f"--where {text}: expected a number for {column}, was '{value}'.") from error

    def holds(self, row: Row) -> bool:
        """Return whether a row meets the condition; texts may have `*` and `?` for any characters."""
        found = row[self.column]
        if self.relation in _ORDERS:
            return found is not None and _ORDERS[self.relation](found, float(self.value))
        if isinstance(self.value, str):
            is_equal = fnmatch.fnmatchcase(str(found), self.value)
        else:
            is_equal = found is not None and float(found) == self.value
        return is_equal is (self.relation == "=")


def sorted_rows(rows: Iterable[Row], key: str, columns: Sequence[str]) -> list[Row]:
    """Return rows by a column, `-COLUMN` for the largest first; rows without a value come last.

    Raises:
        UsageError: there is no such column.
    """
    column, is_reversed = key.removeprefix("-"), key.startswith("-")
    check_column("--sort", column, columns)
    having, lacking = [], []
    for row in rows:
        (lacking if row[column] in (None, "") else having).append(row)
    return [*sorted(having, key=lambda row: row[column], reverse=is_reversed), *lacking]


def check_column(option: str, column: str, columns: Sequence[str]) -> None:
    """Refuse a column that there is not.

    Raises:
        UsageError: with those that there are.
    """
    if column not in columns:
        raise UsageError(f"{option}: expected one of the columns {', '.join(columns)}, was '{column}'.")
