import sys
from pathlib import Path

# Importlib mode puts no test folder on the path; briefings and observations are those of the agents' tests.
sys.path.insert(0, str(Path(__file__).parent.parent / "agents"))
