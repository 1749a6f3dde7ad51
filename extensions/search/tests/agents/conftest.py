import sys
from pathlib import Path

# Importlib mode puts no test folder on the path; briefings and observations are shared by the tests of this folder.
sys.path.insert(0, str(Path(__file__).parent))
