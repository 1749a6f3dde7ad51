from dataclasses import dataclass
from types import SimpleNamespace

from gslcosim.agent_kit.settings import extract_settings


@dataclass(frozen=True, kw_only=True)
class _Part:
    margin_m: float
    step_m: float = 0.5


def test_a_part_of_settings_takes_its_own_and_keeps_defaults_of_the_rest():
    assert extract_settings(_Part, SimpleNamespace(margin_m=2.0, other=1)) == _Part(margin_m=2.0)
    assert extract_settings(_Part, SimpleNamespace(margin_m=2.0, step_m=3.0)) == _Part(margin_m=2.0, step_m=3.0)
