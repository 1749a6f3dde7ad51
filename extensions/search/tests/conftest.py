import sys
from pathlib import Path

# Importlib mode puts no test folder on the path; flights and policies that tests make up are shared by its modules.
sys.path[:0] = [str(Path(__file__).parent / folder) for folder in ("agents", "unit/learned", "unit/posterior")]
