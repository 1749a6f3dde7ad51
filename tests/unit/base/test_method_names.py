"""Names of methods from what starts agents."""

import pytest

from gslcosim.base.method_names import join_methods, name_method


@pytest.mark.parametrize(
    ("python", "name"),
    [
        ("dung_beetle", "dung_beetle"),
        ("upwind.py", "upwind"),
        ("/home/me/searches/upwind.py", "upwind"),
        ("my_search/agent.py", "my_search"),
        ("my_search/method.yaml", "my_search"),
        ("/home/me/my_search/src/main.py", "my_search"),
        ("my_search/agent/main.py", "my_search"),
        ("../agent.py", "agent"),
        ("agent.py", "agent"),
    ],
)
def test_a_python_agent_is_named_after_its_file_or_its_folder(python, name):
    assert name_method(python=python) == name


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["./upwind"], "upwind"),
        (["/home/me/search/build/agent"], "search"),
        (["/home/me/search/target/release/dung-beetle"], "dung-beetle"),
        (["python3", "-u", "lines.py", "--fast"], "lines"),
        (["octave-cli", "--norc", "/home/me/upwind.m"], "upwind"),
        (["java", "-jar", "build/my-beetle.jar"], "my-beetle"),
        (["./upwind", "settings.yaml", "--leg_m=1.5", "0.25"], "upwind"),
    ],
)
def test_a_command_is_named_after_its_program_or_script(command, name):
    assert name_method(command=command) == name


def test_an_agent_that_attaches_itself_is_called_as_the_user_says():
    assert name_method(method="human") == "human"
    assert name_method() == "attached"


def test_several_methods_are_named_once_each():
    assert join_methods(["surge_cast", "", "e_coli", "surge_cast"]) == "surge_cast+e_coli"
