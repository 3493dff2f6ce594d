"""A law that is changed in its one place changes in the exact engine, the chain, its check and the observer."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import sim.laws

CHANGES = {
    "return (level * slip + viscous * speed)": "return 1.2 * (level * slip + viscous * speed)",
    "return 2.0 * spring_torque if": "return 2.5 * spring_torque if",
    "return (load + way * bearing1) / eta1": "return (load + way * bearing1) / eta1**2",
    "depth += cube * room": "depth += 1.5 * cube * room",
}
PROGRAM = """
import importlib.util, json, sys
specification = importlib.util.spec_from_file_location("sim.laws", sys.argv[1])
laws = importlib.util.module_from_spec(specification)
sys.modules["sim.laws"] = laws
specification.loader.exec_module(laws)
import sim
sim.laws = laws
import numpy as np
from sim.investigation.data.preprocessing import prepare
from sim.investigation.model.observer import Nuisance, Observer
from sim.rotational.components import BearingFriction, ElastoBacklash, Inertia, LossyGear, SpringDamper, Torque, Sine
from sim.rotational.drive_train import DriveTrain
from sim.chain.components import GearMesh, MeshDent
from sim.chain.reduction import chain_of

motor, load = Inertia(J=1.0), Inertia(J=2.0)
friction = DriveTrain.series(motor=motor, friction=BearingFriction([[0, 1.0]]))
contact = DriveTrain.series(motor=motor, mesh=ElastoBacklash(c=50.0, d=20.0, b=0.1), load=load)
spring = SpringDamper(c=500.0, d=20.0)
losses = DriveTrain.series(motor=motor, gear=LossyGear(2.0, [0, 0.9, 0.9, 0, 0]), mesh=spring, load=load)
dent = MeshDent(0.0, 2.0, 0.05)
dents = DriveTrain.series(motor=motor, mesh=GearMesh(c=500.0, d=20.0, b=0.01, dents=(dent,)), load=load)
time = np.arange(8000) / 1000.0
angle = 5.0 * np.sin(np.pi * time / 2.0)
out = {}
for name, train in {"friction": friction, "contact": contact, "losses": losses, "dents": dents}.items():
    driven = train.add("drive", Torque(Sine(8.0, 0.7)), flange="motor.flange_a")
    engines = ("exact", "chain") if train.affine else ("chain",)
    found = {engine: sim.simulate(driven, 2.0, 1000.0, engine=engine)["motor.w"] for engine in engines}
    chain = chain_of(train)
    load = angle / chain.ratio - 0.2 * np.sin(3.0 * time)
    observer = Observer(prepare(1000.0, np.zeros(time.size), angle, load), 1.0, 1.0, True)
    seen = observer.predict(chain, Nuisance())
    found["observer"] = seen.torque + seen.guide
    out[name] = {engine: [float(np.std(values)), float(values[-700])] for engine, values in found.items()}
print(json.dumps(out))
"""


def results(laws: Path) -> dict[str, dict[str, list[float]]]:
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(laws)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, dict[str, list[float]]] = json.loads(done.stdout)
    return found


@pytest.mark.slow
def test_a_law_has_one_place(tmp_path: Path) -> None:
    """Whether a run of the chain passes at all with a law changed, its check says, which takes the same laws."""
    source = Path(sim.laws.__file__).read_text(encoding="utf-8")
    for right, wrong in CHANGES.items():
        assert right in source
        source = source.replace(right, wrong)
    changed = tmp_path / "laws.py"
    changed.write_text(source, encoding="utf-8")
    before, after = results(Path(sim.laws.__file__)), results(changed)
    same = [
        (law, engine)
        for law, engines in before.items()
        for engine in engines
        if after[law][engine] == pytest.approx(engines[engine], rel=1e-6)
    ]
    assert not same
    assert {law: set(engines) for law, engines in before.items()}["losses"] == {"exact", "chain", "observer"}
    for law in ("friction", "contact", "losses"):
        assert after[law]["exact"] == pytest.approx(after[law]["chain"], rel=1e-3)
