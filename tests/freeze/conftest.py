import sys
from pathlib import Path

# Importlib mode puts no test folder on the path; the modules of the freeze find each other as those of its script do.
sys.path.insert(0, str(Path(__file__).parent))
