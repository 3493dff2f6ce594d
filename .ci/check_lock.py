"""Fail if a lock file is out of step with pyproject.toml, lacks hashes, or names an address."""

import re
import sys
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PINNED = re.compile(r"^([A-Za-z0-9._-]+)==([^ ;\\]+)", re.MULTILINE)


def faults(lock: Path, extras: tuple[str, ...]) -> list[str]:
    """Return what is wrong with one lock file, in words."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = list(project["dependencies"])
    for extra in extras:
        wanted += project["optional-dependencies"][extra]
    text = lock.read_text()
    pinned = {canonicalize_name(name): version for name, version in PINNED.findall(text)}
    found = []
    if "://" in text:
        found.append(f"{lock.name} names an address")
    for name in pinned:
        if not re.search(rf"^{re.escape(name)}==.*\\\n +--hash=sha256:", text, re.MULTILINE):
            found.append(f"{lock.name}: {name} has no hash")
    for requirement in map(Requirement, wanted):
        version = pinned.get(canonicalize_name(requirement.name))
        if version is None:
            found.append(f"{lock.name}: {requirement.name} is missing; run `make lock`")
        elif version not in requirement.specifier:
            found.append(f"{lock.name}: {requirement.name} {version} is not {requirement.specifier}; run `make lock`")
    return found


def main() -> int:
    """Check the lock files: of what runs, and of what tests need beside it."""
    runtime, tests = ROOT / "requirements.lock", ROOT / "requirements-test.lock"
    found = faults(runtime, ("logs", "record")) + faults(tests, ("logs", "record", "test"))
    apart = sorted(set(PINNED.findall(runtime.read_text())) - set(PINNED.findall(tests.read_text())))
    found += [
        f"{tests.name}: {name} is not {version}, as in {runtime.name}; run `make lock`" for name, version in apart
    ]
    print("\n".join(found) or "the lock files are in step with pyproject.toml")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
