"""Kinds of files are recognised by what they say, else by their names."""

import pytest

from gslcosim.scenario.checks.file_kinds import find_file_kind


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("a.yaml", "schema: gslcosim/suite/1\n", "suite"),
        ("a.yaml", "# a note\n\n{schema: 'gslcosim/method/1', broken: [\n", "method"),
        ("a.yaml", "name: x\n\"schema\": gslcosim/train/1\n", "train"),
        ("a.yaml", "schema: gslcosim/family/1\n", "family"),
        ("suite.yaml", "schema: gslcosim/scenario/1\n", "scenario"),
        ("suite.yaml", "name: x\n", "suite"),
        ("method.yaml", "", "method"),
        ("x.train.yaml", "schema: gslcosim/unknown/1\n", "train"),
        ("a.yaml", "name: x\n", "scenario"),
        ("a.yaml", "text: schema gslcosim/suite/1\n", "scenario"),
    ],
)  # fmt: skip
def test_a_file_is_what_it_says_it_is(tmp_path, name, text, kind):
    path = tmp_path / name
    path.write_text(text)
    found, place = find_file_kind(str(path))
    assert (found.name, place) == (kind, str(path))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("tiny_room", "scenario"), ("smoke", "suite"), ("open_halls", "family"), ("open_halls_ctrnn", "train"),
        ("surge_cast", "method"), ("no_such_thing", "scenario"),
    ],
)  # fmt: skip
def test_bundled_files_are_found_by_name(name, kind):
    assert find_file_kind(name)[0].name == kind


def test_a_folder_stands_for_the_suite_or_card_in_it(tmp_path):
    (tmp_path / "method.yaml").touch()
    kind, path = find_file_kind(str(tmp_path))
    assert (kind.name, path) == ("method", str(tmp_path / "method.yaml"))
