import pytest
import synthetic

from gslcosim_archive.signing.keys import write_key
from gslcosim_archive.signing.signed_results import sign_results


@pytest.fixture(scope="session")
def key(tmp_path_factory):
    path = tmp_path_factory.mktemp("key") / "ada"
    write_key(path, "ada")
    return path


@pytest.fixture(scope="session")
def signed_once(tmp_path_factory, key):
    """Signed results of two entries with a program; tests copy them."""
    plan = synthetic.Plan(
        methods=synthetic.USUAL[:2], starts_m=synthetic.STARTS_M[:2], repetitions=2, n_points=5, maps=False
    )
    folder = synthetic.make_results(tmp_path_factory.mktemp("signed") / "results", plan)
    (folder / "agents" / "mine").mkdir(parents=True)
    (folder / "agents" / "mine" / "agent.py").write_text("print('agent')\n")
    (folder / "agents" / "mine" / "method.yaml").write_text("title: Mine\n")
    sign_results(folder, key, author="Ada", signed_at="2026-11-27T12:00:00+00:00")
    return folder
