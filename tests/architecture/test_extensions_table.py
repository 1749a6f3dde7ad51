"""The table of what extensions offer is what they register."""

from extensions_table import TABLE, build_table


def test_the_table_is_what_extensions_register():
    assert TABLE.read_text() == build_table(), "`make contract` rewrites it"
