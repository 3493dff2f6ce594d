"""Where measured data lies: never in the repository."""

import os
from pathlib import Path

SHARED = Path(os.environ.get("GEARCASE_SHARED", Path(__file__).resolve().parents[2] / "shared"))
