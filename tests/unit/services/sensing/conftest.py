import sys
from pathlib import Path

# Tests are imported by file, so what they share is found beside them.
sys.path.insert(0, str(Path(__file__).parent))
