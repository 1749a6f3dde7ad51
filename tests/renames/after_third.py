"""What follows tests/renames/third.yaml and is no import: lists of code, names in strings and tables of lazy imports.

`python tests/renames/after_third.py` changes the checkout it is called in, after rename.py and `ruff check --fix`.
"""

# ruff: noqa: E501, T201 - a script of texts that prints

import sys
from pathlib import Path

REPLACEMENTS = {
    "gslcosim/bench/__init__.py": {'"run": "api",': '"run": "execution.runner",'},
    "gslcosim/environment/generation/__init__.py": {': "batch",': ': "builder",'},
    "gslcosim/environment/generation/cache.py": {
        '"gslcosim/environment/layouts", "gslcosim/environment/geometry_source.py"]': '"gslcosim/environment/layouts"]',
        'if wind.solver == "openfoam" else ["gslcosim/flow/*", "gslcosim/flow/boundaries"]': (
            'if wind.solver == "openfoam" else ["gslcosim/flow/*"]'
        ),
    },
    "gslcosim/runtime/__init__.py": {
        """`service_join.join_as_services` and `agent_join.join_as_agent` are the two forms of `gslcosim join`;
`run_server.RunServer` is the side of the run's own host.""": (
            "For `gslcosim join` there are `remote_join.join_as_services` and `join_as_agent`; `remote_server.RunServer` is the\n"
            "side of the host that runs the others."
        ),
    },
    "services/fields/tape.py": {
        '"gases.py", "stored/tape.py",': '"gases.py", "tape.py",',
        '"environment/model.py", "environment/model.py",': '"environment/model.py",',
    },
    "services/recorder/service.py": {
        '("blueprint", "rows.wind", "recording_file", "run_recording", "summary")': (
            '("blueprint", "recording_file", "rows.events", "run_recording")'
        ),
        "def _import_early() -> None:\n    preload_modules()\n\n\n": "",
        "import_early=_import_early,": "import_early=preload_modules,",
    },
    "tests/unit/base/test_socket_peers.py": {
        "sandbox import landlock, seccomp": "sandbox import confinement",
        "sandbox import seccomp": "sandbox import confinement",
        "seccomp.filter_calls": "confinement.filter_calls",
        "landlock.give_up": "confinement.give_up",
    },
}


def main() -> None:
    """Replace each text, which has to be there."""
    is_whole = True
    for name, texts in REPLACEMENTS.items():
        path = Path(name)
        content = path.read_text()
        for old, new in texts.items():
            if old not in content:
                print(f"{name}: expected {old!r}")
                is_whole = False
            content = content.replace(old, new)
        path.write_text(content)
    sys.exit(not is_whole)


if __name__ == "__main__":
    main()
