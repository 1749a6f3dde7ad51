"""A new participant is the example under another name, and never written over somebody's files."""

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_conformance.scaffold import create_participant


@pytest.mark.parametrize(("language", "program"), [("c", "my_fan.c"), ("python", "my_fan.py"), ("rust", "my_fan.rs")])
def test_a_new_participant_has_its_name_everywhere(language, program, tmp_path):
    next_steps = create_participant(language, "my_fan", tmp_path / "fan")
    texts = [path.read_text() for path in (tmp_path / "fan").iterdir()]
    assert {path.name for path in (tmp_path / "fan").iterdir()} == {program, "ventilated_room.yaml"}
    assert not any("air_conditioner" in text for text in texts)
    assert "name: my_fan" in (tmp_path / "fan" / "ventilated_room.yaml").read_text()
    assert "gslcosim participant check" in next_steps


@pytest.mark.parametrize(
    ("language", "name", "next_steps"),
    [
        ("cobol", "fan", "expected one of the languages c, python, rust, was 'cobol'"),
        ("c", "My-Fan", "expected a name of lower-case letters, digits and _"),
        ("c", "fan", "expected a folder that is new or empty"),
    ],
)
def test_what_cannot_be_written_is_refused(language, name, next_steps, tmp_path):
    (tmp_path / "somebodys").write_text("file")
    with pytest.raises(UsageError) as caught:
        create_participant(language, name, tmp_path)
    assert next_steps in str(caught.value)
