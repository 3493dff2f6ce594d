"""Obvious alternatives on the same runs: PySINDy (STLSQ, smoothed, cross-validated) and the BIC of independent noise.

Both see the same library of terms, in weak form (convolved with one kernel), with the torque on the left of each
equation: A, the sum of both masses; B, motor and shaft, only with a load encoder.  Where a term enters A and B tells
motor, shaft and load apart.  Only their first choice is held against them.
"""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pysindy
from numpy.typing import NDArray
from scipy.signal.windows import blackmanharris
from threadpoolctl import threadpool_limits

from benchmarks.hidden_effects.generator import Scenario
from benchmarks.hidden_effects.scoring import judge

Array = NDArray[np.float64]
RATE_HZ = 2000
DECIMATE = 20
BLOCKS = 6
THRESHOLDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3)
ORDINARY = ("ordinary", None)


@dataclass(frozen=True)
class Term:
    """Columns (rows of A then B, k) of one cause; `name`: mechanism and place."""

    name: tuple[str, str | None]
    columns: Array


@dataclass(frozen=True)
class Library:
    """The measured torque (n), the terms of the description (n, p) and the candidates."""

    torque: Array
    ordinary: Array
    candidates: tuple[Term, ...]


def _kernels(length: int = 51) -> tuple[Array, Array, Array]:
    """Return a kernel and its first two derivatives [1/s, 1/s2], with discrete moments corrected."""
    kernel = blackmanharris(length)
    kernel /= kernel.sum()
    place = (np.arange(length) - length // 2) / RATE_HZ
    first = np.gradient(kernel) * RATE_HZ
    first /= -np.sum(first * place)
    second = np.gradient(first) * RATE_HZ
    second -= second.mean()
    second *= 2 / np.sum(second * place**2)
    return kernel, first, second


def _play(twist: Array, width: float) -> Array:
    """Return the play operator's output (Prandtl and Ishlinskii)."""
    out = np.empty_like(twist)
    state = twist[0]
    for place, value in enumerate(twist):
        state = min(max(state, value - width), value + width)
        out[place] = state
    return twist - out


def build_library(scenario: Scenario) -> Library:
    """Build all terms from the recording and the description."""
    assert scenario.telemetry is not None
    axis, measured = tomllib.loads(scenario.axis), scenario.telemetry
    time = np.arange(measured["time_s"][0], measured["time_s"][-1], 1 / RATE_HZ)
    motor, torque = (
        np.interp(time, measured["time_s"], measured[name]) for name in ("motor_position_rad", "motor_torque_nm")
    )
    ratios = [s.get("ratio") or s["driven_teeth"] / s["driver_teeth"] for s in axis.get("stages", [])]
    ratio = float(np.prod(ratios)) if ratios else 1.0
    both = "load_position_rad" in measured
    load = np.interp(time, measured["time_s"], measured["load_position_rad"]) if both else motor / ratio
    kernel, first, second = _kernels()

    def smooth(signal: Array, by: Array = kernel) -> Array:
        return np.convolve(signal, by, "valid")[::DECIMATE]

    speed = np.convolve(np.pad(motor, len(first) // 2, mode="edge"), first, "valid")
    # near standstill the sign of friction is not known: such rows are left out
    moving = smooth((np.abs(speed) < 0.01 * np.max(np.abs(speed))).astype(float)) < 1e-9

    def rows(signal: Array, where: str, by: Array = kernel) -> Array:
        convolved = smooth(signal, by)[moving]
        none = np.zeros_like(convolved)
        parts = [convolved if "A" in where else none, convolved if "B" in where else none]
        return np.concatenate(parts) if both else convolved

    sign = np.tanh(speed / (0.003 * np.max(np.abs(speed))))
    twist = motor / ratio - load
    ordinary = [
        rows(motor, "AB", second),
        rows(torque, "AB", first),
        *([rows(load, "A", second), rows(twist, "B"), rows(twist, "B", first)] if both else []),
    ]
    given = {
        "coulomb_friction": (sign, axis["motor"]["coulomb_friction_n_m"]),
        "viscous_friction": (speed, axis["motor"]["viscous_friction_n_m_s_per_rad"]),
    }
    terms = []
    for name, (column, value) in given.items():
        columns = [rows(column, "AB"), *([rows(column, "A")] if both else [])]
        if value:
            ordinary += columns
        else:
            terms.append(Term((name, None), np.column_stack(columns)))
    terms += _terms(axis, ratios, time, motor, load, twist, torque, speed, sign, rows, both=both)
    return Library(
        np.concatenate([smooth(torque)[moving]] * (2 if both else 1)), np.column_stack(ordinary), tuple(terms)
    )


def _terms(
    axis: dict[str, Any],
    ratios: Sequence[float],
    time: Array,
    motor: Array,
    load: Array,
    twist: Array,
    torque: Array,
    speed: Array,
    sign: Array,
    rows: Callable[..., Array],
    *,
    both: bool,
) -> list[Term]:
    """Return the candidates."""
    shaft = "B" if both else "A"

    def waves(angle: Array, where: str, *orders: float) -> list[Array]:
        return [rows(wave(order * angle), where) for order in orders for wave in (np.cos, np.sin)]

    terms = [
        Term(("torque_offset", None), rows(np.ones_like(time), "AB")[:, None]),
        Term(("friction_asymmetry", None), np.column_stack([rows(abs(sign), "AB"), rows(abs(speed), "AB")])),
        Term(("load_dependent_loss", None), rows(np.abs(torque) * sign, "AB")[:, None]),
        Term(("friction_drift", None), np.column_stack([rows(time * sign, "AB"), rows(time * speed, "AB")])),
        Term(("gravity_imbalance", None), np.column_stack(waves(load, "A", 1))),
        Term(("eccentricity", "motor"), np.column_stack(waves(motor, shaft, 1))),
    ]
    terms += [
        Term(("stribeck_friction", None), rows(np.exp(-np.abs(speed) / (part * np.max(speed))) * sign, "AB")[:, None])
        for part in (0.03, 0.08, 0.16)
    ]
    terms += [
        Term(("torque_ripple", "motor"), np.column_stack(waves(motor, "AB", order))) for order in (2, 4, 6, 12, 24)
    ]
    terms += [
        Term(("electrical_hum", None), np.column_stack(waves(2 * np.pi * frequency * time, "AB", 1)))
        for frequency in (50, 60)
    ]
    angle = motor
    for stage, ratio in zip(axis.get("stages", []), ratios, strict=True):
        angle = angle / ratio
        name, teeth = stage["name"], stage.get("driven_teeth")
        terms.append(Term(("eccentricity", name), np.column_stack(waves(angle, shaft, 1))))
        if teeth:
            terms.append(Term(("mesh_error", name), np.column_stack(waves(angle, shaft, teeth, 2 * teeth))))
        for at in np.arange(36) * np.pi / 18:
            bump = np.exp(40 * (np.cos(angle - at) - 1))
            columns = [rows(bump * (sign * flank > 0), shaft) for flank in (1, -1)]
            terms.append(Term(("tooth_damage", name), np.column_stack(columns)))
    if both and ratios:
        reach = float(np.quantile(np.abs(twist - np.median(twist)), 0.99))
        middle = twist - np.median(twist)
        terms += [
            Term(("backlash", "output"), rows(np.clip(middle, -gap, gap), "B")[:, None])
            for gap in reach * np.array([0.05, 0.15, 0.4])
        ]
        terms.append(Term(("stiffness_hardening", None), rows(middle**3, "B")[:, None]))
        plays = [rows(_play(middle, part * reach), "B") for part in (0.1, 0.4)]
        terms.append(Term(("hysteresis", None), np.column_stack(plays)))
    return terms


def _document(name: tuple[str, str | None] | None) -> dict[str, Any]:
    if name is None or name == ORDINARY:
        return {"verdict": "nothing_missing", "findings": []}
    finding = {"mechanism": name[0], "location": name[1], "probability": 1.0, "parameters": []}
    return {"verdict": "named", "findings": [finding]}


def _left(torque: Array, columns: Array) -> float:
    residual = torque - columns @ np.linalg.lstsq(columns, torque, rcond=None)[0]
    return float(residual @ residual)


def _unit(columns: Array) -> Array:
    return columns / (np.linalg.norm(columns, axis=0) + 1e-300)


def independent_bic(scenario: Scenario) -> dict[str, Any]:
    """Choose the one term that lowers the BIC of independent noise most, if any does."""
    library = build_library(scenario)
    count, base = len(library.torque), _unit(library.ordinary)
    best, chosen = count * np.log(_left(library.torque, base)), None
    for term in library.candidates:
        columns = np.column_stack([base, _unit(term.columns)])
        score = count * np.log(_left(library.torque, columns)) + term.columns.shape[1] * np.log(count)
        if score < best:
            best, chosen = score, term.name
    return _document(chosen)


def sindy(scenario: Scenario) -> dict[str, Any]:
    """Fit by PySINDy's STLSQ and name the strongest candidate it keeps.

    The threshold is the largest within one standard error of the least cross-validated error.
    """
    library = build_library(scenario)
    columns = np.column_stack([library.ordinary, *(term.columns for term in library.candidates)])
    scale = np.sqrt(np.mean(columns**2, axis=0)) + 1e-12
    matrix, target = columns / scale, library.torque / np.std(library.torque)
    blocks = np.array_split(np.arange(len(target)), BLOCKS)

    def fit(rows: NDArray[np.int64], threshold: float) -> Array:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it warns whenever a threshold empties the model
            optimiser = pysindy.STLSQ(threshold=threshold, alpha=1e-3)
            optimiser.fit(matrix[rows], target[rows, None])
        return np.asarray(optimiser.coef_)[0]

    def errors(threshold: float) -> Array:
        folds = ((np.setdiff1d(np.arange(len(target)), block), block) for block in blocks)
        return np.array([np.mean((target[out] - matrix[out] @ fit(kept, threshold)) ** 2) for kept, out in folds])

    tried = {threshold: errors(threshold) for threshold in THRESHOLDS}
    best = min(tried.values(), key=np.mean)
    allowed = best.mean() + np.std(best) / np.sqrt(BLOCKS)
    threshold = max(threshold for threshold, each in tried.items() if each.mean() <= allowed)
    found = fit(np.arange(len(target)), threshold)
    energies = []
    start = library.ordinary.shape[1]
    for term in library.candidates:
        part = slice(start, start + term.columns.shape[1])
        # what the ordinary terms could do as well is no sign of a missing one
        energies.append(_left(matrix[:, part] @ found[part], matrix[:, : library.ordinary.shape[1]]))
        start = part.stop
    strongest = int(np.argmax(energies))
    return _document(library.candidates[strongest].name if energies[strongest] > 0 else None)


PEERS: dict[str, Callable[[Scenario], dict[str, Any]]] = {"PySINDy STLSQ": sindy, "i.i.d. BIC": independent_bic}


def ask_all(scenario: Scenario) -> dict[str, Any]:
    """Return every peer's document, by its name."""
    with threadpool_limits(1):  # small matrices: more threads only wait for each other, five times as long
        return {name: peer(scenario) for name, peer in PEERS.items()}


def side_by_side(results: Sequence[dict[str, Any]]) -> str:
    """Return a table: Gearcase and its peers on the same runs with one effect of the library, and on nulls."""
    runs = [r for r in results if "peers" in r]
    single = [r for r in runs if r["answer"]["group"] in ("mechanics", "sensor")]
    nulls = [r for r in runs if not r["answer"]["hidden"]]
    lines = [f"{'':16s} {'top-1 right':>12s} {'wrong name':>12s} {'false alarm':>12s}   ({len(single)} / {len(nulls)})"]
    for name in ("Gearcase", *PEERS):

        def judged(result: dict[str, Any], name: str = name) -> Any:
            document = result["document"] if name == "Gearcase" else result["peers"][name]
            return judge(result["answer"], document)

        right = [judged(r).top for r in single]
        wrong = [bool(judged(r).wrong_names) for r in single]
        alarms = [judged(r).outcome == "false alarm" for r in nulls]
        shares = [f"{np.mean(values):12.3f}" if values else f"{'-':>12s}" for values in (right, wrong, alarms)]
        lines.append(f"{name:16s} " + " ".join(shares))
    return "\n".join(lines)
