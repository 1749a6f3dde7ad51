import pytest
import yaml

from gslcosim.base.errors import MethodError
from gslcosim.methods.card import find_card_beside, find_unmet_needs, load_card
from gslcosim_services.sensing.models import sensor_kind

CARD = {
    "schema": "gslcosim/method/1",
    "title": "Test search",
    "family": "reactive",
    "summary": "Searches.",
    "paper": "none",
    "needs": {"sensors": {"gas": 2, "wind": 1}, "knows": ["map"], "radio": True},
    "parameters": {
        "step_m": {"default": 1.0, "min": 0.1, "max": 5, "unit": "m", "origin": "ours", "meaning": "leg"},
        "n_legs": {"default": 3, "min": 1, "origin": "ours", "meaning": "legs"},
        "rule": {"default": "random", "choices": ["random", "bounce"], "origin": "ours", "meaning": "wall"},
        "declares": {"default": True, "origin": "ours", "meaning": "whether"},
        "weights": {"default": [0.5, 1], "min": 0, "origin": "ours", "meaning": "weights"},
        "limit_m": {"default": None, "type": "float", "origin": "ours", "meaning": "limit"},
    },
}


@pytest.fixture
def card(tmp_path):
    """Load the card with changes, as a file."""

    def load(**changes):
        path = tmp_path / "method.yaml"
        path.write_text(yaml.safe_dump({**CARD, **changes}, sort_keys=False))
        return load_card(path)

    return load


def sensors(*models):
    from gslcosim.contract.messages import SensorDescription

    kinds = [sensor_kind(model) for model in models]
    return [
        SensorDescription(
            name=f"s{i}", model=kind.name, quantity=kind.quantity, unit=kind.unit, mount_body_m=(0.0, 0.0, 0.0)
        )
        for i, kind in enumerate(kinds)
    ]


ENOUGH = {"sensors": sensors("tgs2600", "pid", "anemometer"), "knows": ("map",), "n_channels": 1, "parameters": {}}


def unmet_needs(card, **changes):
    return [str(shortage) for shortage in find_unmet_needs(card, **{**ENOUGH, **changes})]


def test_a_method_with_all_it_needs_lacks_nothing(card):
    assert unmet_needs(card()) == []


def test_everything_that_is_missing_is_reported_with_a_remedy(card):
    texts = unmet_needs(card(), sensors=sensors("pid"), knows=(), n_channels=0)
    assert len(texts) == 4
    assert "at least 2 of kind gas for Test search, was 1 (pid). Add for example {model: tgs2600" in texts[0]
    assert "kind wind" in texts[1]
    assert "knows: expected map: true" in texts[2]
    assert "Add knows: {map: true}" in texts[2]
    assert "channels: [{name: radio}]" in texts[3]


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"stepm": 1.0}, "Did you mean step_m?"),
        ({"speed": 1.0}, "a parameter of Test search (step_m, n_legs"),
        ({"step_m": 6.0}, "parameters.step_m: expected at most 5 m, was 6.0. Its default is 1.0."),
        ({"step_m": "far"}, "expected a number, was 'far'"),
        ({"step_m": True}, "expected a number, was True"),
        ({"n_legs": 1.5}, "expected a whole number, was 1.5"),
        ({"n_legs": 0}, "expected at least 1, was 0"),
        ({"rule": "bouncing"}, "expected one of random, bounce, was 'bouncing'"),
        ({"declares": 1}, "expected true or false, was 1"),
        ({"weights": (0.5, -1.0)}, "expected at least 0"),
        ({"weights": 1.0}, "expected a list of numbers"),
        ({"limit_m": "x"}, "expected a number"),
    ],
)
def test_wrong_parameters_are_reported(card, parameters, words):
    (text,) = unmet_needs(card(), parameters=parameters)
    assert words in text


def test_settings_are_the_given_values_over_the_defaults(card):
    settings = card().settings({"step_m": 2, "weights": (1, 2)})
    assert settings["step_m"] == 2.0
    assert isinstance(settings["step_m"], float)
    assert settings["weights"] == (1.0, 2.0)
    assert (settings["n_legs"], settings["rule"], settings["declares"], settings["limit_m"]) == (
        3,
        "random",
        True,
        None,
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"family": "animal"}, "family"),
        ({"needs": {"sensors": ["smell"]}}, "expected kinds among gas"),
        ({"later": 1}, "later"),
        ({"parameters": {"step_m": {"default": 9.0, "max": 5, "origin": "x", "meaning": "x"}}}, "at most 5"),
        ({"parameters": {"step_m": {"default": None, "origin": "x", "meaning": "x"}}}, "expected a type"),
    ],
)
def test_a_wrong_card_is_refused_with_its_file(card, changes, words, tmp_path):
    with pytest.raises(MethodError, match=words) as caught:
        card(**changes)
    assert str(tmp_path / "method.yaml") in str(caught.value)


def test_what_is_no_yaml_is_refused(tmp_path):
    (tmp_path / "method.yaml").write_text("a: [")
    with pytest.raises(MethodError, match="can be read"):
        find_card_beside(tmp_path / "agent.py")
    (tmp_path / "method.yaml").write_text("just text")
    with pytest.raises(MethodError, match="a YAML map"):
        find_card_beside(tmp_path / "agent.py")


def test_a_program_without_a_card_has_none(tmp_path):
    assert find_card_beside(tmp_path / "agent.py") is None


def test_a_card_has_its_own_parameters_first_then_included_ones_that_it_does_not_replace(card):
    own = {"n_headings": {**CARD["parameters"]["n_legs"], "default": 4}, "extra": CARD["parameters"]["step_m"]}
    whole, changed = card(includes=["information"], parameters={}), card(includes=["information"], parameters=own)
    assert list(changed.parameters) == [*own, *(name for name in whole.parameters if name not in own)]
    assert changed.parameters["n_headings"].default == 4
    assert changed.parameters["cell_m"] == whole.parameters["cell_m"]


@pytest.mark.parametrize("included", [["luck"], "information"])
def test_an_unknown_inclusion_is_named(card, included):
    with pytest.raises(MethodError, match=r"includes: expected a list of .*\binformation\b.*, was "):
        card(includes=included)


@pytest.mark.parametrize(
    ("needs", "is_blind"),
    [
        ({"sensors": []}, True),
        ({}, False),
        ({"sensors": ["gas"]}, False),
        ({"sensors": [], "knows": ["source"]}, False),
    ],
)
def test_a_method_that_says_it_needs_no_sensor_is_blind(card, needs, is_blind):
    assert card(needs=needs).is_blind is is_blind


def test_a_beam_of_gas_is_told_from_a_gas_sensor_at_a_point(card):
    """It is a gas sensor, but methods map a reading to the place of the sensor."""
    (text,) = unmet_needs(card(), sensors=sensors("pid", "anemometer", "tdlas"))
    assert "at least 2 of kind gas for Test search, was 1 (pid, anemometer, tdlas)" in text
    assert text.endswith("It measures at a point; tdlas measures along a beam.")
