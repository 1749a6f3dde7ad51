import sys
from pathlib import Path

# Importlib mode puts no test folder on the path; agents in other languages are described with the runs.
sys.path.insert(0, str(Path(__file__).parents[1] / "end_to_end"))
