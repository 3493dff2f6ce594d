"""Fail if a package that runs has a known vulnerability, where the data of known ones can be had; else say that."""

import json
import subprocess
import sys
from pathlib import Path

LOCK = Path(__file__).resolve().parents[1] / "requirements.lock"


def main() -> int:
    """Ask pip-audit."""
    options = ["--disable-pip", "--require-hashes", "--progress-spinner=off", "--timeout=5", "--format=json"]
    command = [sys.executable, "-m", "pip_audit", *options, f"--requirement={LOCK}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    try:
        packages = json.loads(done.stdout)["dependencies"]
    except ValueError:
        packages = []
    asked = [each for each in packages if "skip_reason" not in each]
    for each in asked:
        for found in each["vulns"]:
            print(f"{each['name']} {each['version']}: {found['id']}, mended in {', '.join(found['fix_versions'])}")
    print(f"known vulnerabilities: data of {len(asked)} of {len(packages) or 'all'} packages can be had here")
    return int(any(each["vulns"] for each in asked))


if __name__ == "__main__":
    sys.exit(main())
