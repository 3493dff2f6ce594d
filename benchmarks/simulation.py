"""The paper's axis, 30 s at 8 kHz: the exact engine against scipy's solve_ivp and CVODE with events; error and time."""

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks import Row, best_seconds
from benchmarks.solve_ivp_axis import RATIO, Case, SolveIvpAxis
from sim.rotational.components import ElastoBacklash, Inertia, LossyGear, Sine, Torque
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import Trajectory
from sim.solver import simulate

SECONDS, RATE_HZ = 30.0, 8000.0
CASES = {
    "load 20 kg m2, backlash 1 mrad, damping 200": Case(20.0, 200.0, 1e-3),
    "load 50 kg m2, no backlash, damping 200": Case(50.0, 200.0, 0.0),
}
PEERS = ("RK45", "LSODA", "Radau", "CVODE Adams", "CVODE BDF")


def drive_train(case: Case) -> DriveTrain:
    """Return the same axis for `simulate`."""
    loss = [0, case.efficiency, case.efficiency, case.bearing, case.bearing]
    return DriveTrain.series(
        torque=Torque(Sine(case.amplitude, case.frequency)),
        motor=Inertia(J=case.motor_inertia),
        gear=LossyGear(ratio=RATIO, lossTable=loss),
        mesh=ElastoBacklash(c=case.stiffness, d=case.damping, b=case.backlash),
        load=Inertia(J=case.load_inertia),
    )


def states(result: Trajectory) -> NDArray[np.float64]:
    """The four states of `SolveIvpAxis`, shape (n, 4)."""
    names = ("motor.phi", "motor.w", "mesh.phi_rel", "mesh.w_rel")
    return np.stack([result[name] for name in names], axis=1)


def error(values: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    """Largest difference of any state, relative to its range."""
    return float((np.abs(values - truth).max(axis=0) / np.ptp(truth, axis=0)).max())


def run() -> list[Row]:
    """Measure both cases, then what long runs and many runs cost."""
    rows: list[Row] = []
    for name, case in CASES.items():
        rows += _against_peers(name, case)
    return rows + _scaling(next(iter(CASES.values())))


def _against_peers(name: str, case: Case) -> list[Row]:
    truth = SolveIvpAxis(case).run(SECONDS, RATE_HZ, "DOP853", 1e-12, 1e-14)
    train = drive_train(case)
    ours = error(states(simulate(train, SECONDS, RATE_HZ)), truth)
    label = f"exact engine: {name}"
    best = best_seconds({label: lambda: simulate(train, SECONDS, RATE_HZ)}, rounds=25)[label]
    rows = [Row(label, best, note=f"{SECONDS / best:.0f} x real time (target 5000), error {ours:.1e}")]
    cold = best_seconds({label: lambda: simulate(drive_train(case), SECONDS, RATE_HZ)}, rounds=5)[label]
    rows.append(
        Row(
            "  the same, train never seen before",
            cold,
            cold / best,
            "exact",
            f"{SECONDS / cold:.0f} x real time (target 2000)",
        )
    )
    for method in PEERS:
        begin = time.perf_counter()
        values = SolveIvpAxis(case).run(SECONDS, RATE_HZ, method, 1e-6, 1e-9)
        seconds = time.perf_counter() - begin
        note = f"{SECONDS / seconds:.0f} x real time, error {error(values, truth):.1e} (target: 100 x slower)"
        rows.append(
            Row(
                f"  {method if 'CVODE' in method else f'solve_ivp {method}'}, rtol 1e-6, events",
                seconds,
                seconds / best,
                "exact",
                note,
            )
        )
    return rows


def _scaling(case: Case) -> list[Row]:
    train = drive_train(case)
    calls = {f"{seconds:g} s": (lambda s=seconds: simulate(train, s, RATE_HZ)) for seconds in (15.0, 30.0, 60.0, 120.0)}
    best = best_seconds(calls, rounds=7)
    base = best["30 s"] / 30.0
    return [
        Row(f"  duration {name}", seconds, seconds / (float(name[:-2]) * base), "time per simulated second of 30 s")
        for name, seconds in best.items()
    ]
