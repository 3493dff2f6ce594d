"""The paper's axis, 30 s at 8 kHz: what the exact engine takes, a train that it has never seen, and longer runs."""

from functools import partial

from benchmarks import Row, best_seconds
from sim.rotational.components import ElastoBacklash, Inertia, LossyGear, Sine, Torque
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate

SECONDS, RATE_HZ = 30.0, 8000.0
CASES = {"load 20 kg m2, backlash 1 mrad": (20.0, 1e-3), "load 50 kg m2, no backlash": (50.0, 0.0)}


def drive_train(load_kg_m2: float, gap_rad: float) -> DriveTrain:
    """Return the axis of a load and a gap."""
    return DriveTrain.series(
        torque=Torque(Sine(amplitude=12.0, f=0.45)),
        motor=Inertia(J=0.6),
        gear=LossyGear(ratio=100.0, lossTable=[0, 0.9, 0.9, 0.9, 0.9]),
        mesh=ElastoBacklash(c=1e5, d=200.0, b=gap_rad),
        load=Inertia(J=load_kg_m2),
    )


def run() -> list[Row]:
    """Measure both cases, each again with a train that is compiled anew, then what long runs cost."""
    rows: list[Row] = []
    for name, case in CASES.items():
        train = drive_train(*case)
        best = best_seconds({name: partial(simulate, train, SECONDS, RATE_HZ)}, rounds=25)[name]
        cold = best_seconds({name: lambda case=case: simulate(drive_train(*case), SECONDS, RATE_HZ)}, rounds=5)[name]
        rows.append(Row(name, best, note=f"{SECONDS / best:.0f} x real time (target 5000)"))
        words = f"{SECONDS / cold:.0f} x real time (target 2000)"
        rows.append(Row("  the same, train never seen before", cold, cold / best, "the above", words))
    train = drive_train(*next(iter(CASES.values())))
    calls = {f"  {length:g} s": partial(simulate, train, length, RATE_HZ) for length in (15.0, 30.0, 60.0, 120.0)}
    best_of = best_seconds(calls, rounds=7)
    each_s = best_of["  30 s"] / 30.0
    return rows + [
        Row(name, seconds, seconds / (float(name[:-2]) * each_s), "time per simulated second of 30 s")
        for name, seconds in best_of.items()
    ]
