"""The bill of materials: what is installed to run Gearcase, as CycloneDX 1.6 JSON on stdout.

python -m docs.bill_of_materials > gearcase.cdx.json

Versions and hashes are those of the lock files; what is there to test alone is left out, licences are those that the
installed packages name.
"""

import base64
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PINNED = re.compile(r"^([A-Za-z0-9._-]+)==([^ ;\\\n]+)((?: *\\\n +--hash=sha256:[0-9a-f]{64})*)", re.MULTILINE)
HASH = re.compile(r"sha256:([0-9a-f]{64})")


def pinned() -> dict[str, tuple[str, list[str]]]:
    """Return version and SHA-256 of the files of every package in the lock, by its name."""
    text = (ROOT / "requirements.lock").read_text()
    return {canonicalize_name(name): (version, HASH.findall(hashes)) for name, version, hashes in PINNED.findall(text)}


def to_run() -> dict[str, list[str]]:
    """Return what each package that is needed to run needs itself, by name; `gearcase` is the product."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needs: dict[str, list[str]] = {}
    waiting = [("gearcase", list(map(Requirement, project["dependencies"] + project["optional-dependencies"]["logs"])))]
    while waiting:
        name, wanted = waiting.pop()
        needs[name] = sorted({canonicalize_name(each.name) for each in wanted})
        for each in wanted:
            child = canonicalize_name(each.name)
            if child not in needs:
                needs[child] = []
                waiting.append((child, list(_needed(child, each.extras))))
    return needs


def _needed(name: str, extras: set[str]) -> Iterator[Requirement]:
    try:
        stated = requires(name) or []
    except PackageNotFoundError:
        return
    for requirement in map(Requirement, stated):
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in {"", *extras}):
            yield requirement


def licence(name: str) -> list[dict[str, Any]]:
    """Return the licence that an installed package names."""
    try:
        said = metadata(name)
    except PackageNotFoundError:
        return []
    if expression := said.get("License-Expression"):
        return [{"expression": expression}]
    classes = [each.rpartition(" :: ")[2] for each in said.get_all("Classifier", []) if each.startswith("License ::")]
    words = classes or [line for line in (said.get("License") or "").splitlines()[:1] if line.strip()]
    return [{"license": {"name": each}} for each in words]


def python_components(needs: dict[str, list[str]]) -> list[dict[str, Any]]:
    """Return one component for each Python package. Raises KeyError for one that the lock does not have."""
    lock = pinned()
    found = []
    for name in sorted(set(needs) - {"gearcase"}):
        version, hashes = lock[name]
        reference = f"pkg:pypi/{name}@{version}"
        component: dict[str, Any] = {"type": "library", "bom-ref": reference, "name": name, "version": version}
        component["purl"] = reference
        component["licenses"] = licence(name)
        # one hash a file that the lock allows: which of them is installed depends on the machine
        component["properties"] = [{"name": "lock:sha256", "value": each} for each in hashes]
        found.append(component)
    return found


def browser_components() -> list[dict[str, Any]]:
    """Return one component for each package that pages carry into the browser."""
    lock = json.loads((ROOT / "package-lock.json").read_text())["packages"]
    found = []
    for name in sorted(lock[""]["dependencies"]):
        package = lock[f"node_modules/{name}"]
        version = package["version"]
        algorithm, _, digest = package["integrity"].partition("-")
        assert algorithm == "sha512"
        reference = f"pkg:npm/{name}@{version}"
        found.append(
            {
                "type": "library",
                "bom-ref": reference,
                "name": name,
                "version": version,
                "purl": reference,
                "licenses": [{"license": {"id": package["license"]}}],
                "hashes": [{"alg": "SHA-512", "content": base64.b64decode(digest).hex()}],
            }
        )
    return found


def bill() -> dict[str, Any]:
    """Return the whole document."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needs, lock = to_run(), pinned()
    product = f"pkg:pypi/gearcase@{project['version']}"
    references = {name: f"pkg:pypi/{name}@{lock[name][0]}" for name in needs if name != "gearcase"}
    references["gearcase"] = product
    browser = browser_components()
    dependencies = [
        {"ref": references[name], "dependsOn": [references[each] for each in wanted]}
        for name, wanted in sorted(needs.items())
    ]
    next(each for each in dependencies if each["ref"] == product)["dependsOn"] += [each["bom-ref"] for each in browser]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": product,
                "name": "gearcase",
                "version": project["version"],
                "purl": product,
            }
        },
        "components": [*python_components(needs), *browser],
        "dependencies": dependencies,
    }


if __name__ == "__main__":
    json.dump(bill(), sys.stdout, indent=1)
    print()
