"""Sanity figures of a written half: `python -m tests.stranger_bank.check --half work --out DIR`.

Own plain measures only: accuracy of the integration, levels and crest factors, whether bumps lie
where the truth says, and how well simple features that know the period tell the known states apart.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.signal import butter, sosfiltfilt

from . import bank
from .axes import DESIGNS, gearboxes, unit_of
from .kinds import Floats, Half, Recorded, rng_of
from .mechanics import healthy, run, worsen
from .motions import DT, motion_of

FRAME_S = 0.02


def envelope(rec: Recorded, low: float, high: float) -> Floats:
    """RMS per 20 ms frame of a band [Hz], ends included."""
    x = rec.samples.astype(float)
    x = x - x.mean()
    kind, edge = ("low", high) if low <= 0 else ("band", [low, min(high, 0.45 * rec.rate_hz)])
    y = sosfiltfilt(butter(3, edge, kind, fs=rec.rate_hz, output="sos"), x)
    k = round(FRAME_S * rec.rate_hz)
    return np.sqrt(np.mean(y[: y.size // k * k].reshape(-1, k) ** 2, axis=1))


def folded(env: Floats, period_s: float) -> Floats:
    """Median over periods of an envelope, in frames of the period."""
    n = round(period_s / FRAME_S)
    at = (np.arange(env.size) * FRAME_S) % period_s
    which = np.minimum((at / period_s * n).astype(int), n - 1)
    return np.array([np.median(env[which == i]) if np.any(which == i) else 0.0 for i in range(n)])


def features(rec: Recorded) -> Floats:
    """Nine plain numbers per recording (dB and ratios) that know nothing but the period."""
    out = []
    levels = []
    for band in ((0, 200), (200, 800), (800, 3500)):
        env = envelope(rec, *band)[3:-3]
        levels.append(20 * np.log10(np.sqrt(np.mean(env**2)) + 1e-9))
        f = folded(env, rec.period_s)
        mid = np.median(env) + 1e-9
        out += [20 * np.log10(f.max() / mid), 20 * np.log10(np.percentile(f, 90) / mid + 1e-9)]
    x = rec.samples.astype(float)
    out += [20 * np.log10(np.max(np.abs(x)) / x.std())]
    out += [levels[0] - levels[1], levels[2] - levels[1]]
    return np.array(out)


def crest(x: Floats) -> float:
    """Peak over RMS."""
    return float(np.max(np.abs(x)) / np.std(x))


def at_marks(rec: Recorded, marks: tuple[float, ...], reach_s: float) -> tuple[float, float]:
    """Share of the loudest low-band frames within `reach_s` after the marks, and chance."""
    env = envelope(rec, 0, 200)[3:-3]
    t = (np.arange(env.size) + 3.5) * FRAME_S
    near = np.zeros(env.size, bool)
    for m in marks:
        near |= (t > m - 0.03) & (t < m + reach_s)
    loud = np.argsort(-env)[: max(3, round(0.015 * env.size))]
    return float(np.mean(near[loud])), float(np.mean(near))


def after(rec: Recorded, marks: tuple[float, ...]) -> float:
    """Median over marks of the loudest low-band frame of the next 0.1 s, over the median one [dB].

    Marks nearer than 0.15 s to the one before belong to the same bump and are left out.
    """
    env = envelope(rec, 0, 200)
    tops = []
    last = -1.0
    for m in marks:
        if m - last > 0.15:
            k = int(m / FRAME_S)
            if 3 <= k < env.size - 8:
                tops.append(np.max(env[k : k + 6]))
        last = m
    return float(20 * np.log10(np.median(tops) / np.median(env))) if tops else float("nan")


def convergence(half: Half) -> None:
    """Output torque with a four times finer step, for normal and for play."""
    for axis in DESIGNS[half]:
        box = next(b for b in gearboxes(half) if b.axis == axis)
        unit = unit_of(box)
        out = []
        for fault in ("", "play"):
            m = motion_of("trapezoid_dwell", half, unit.design, rng_of(box.name, 1), None)
            b = healthy(unit)
            if fault:
                worsen(b, fault, rng=rng_of("c"), size=8 * unit.windup_rad, span=(0, 1),
                       modern=half == "final")  # fmt: skip

            def torque(finer: int, m=m, b=b, unit=unit) -> Floats:
                r = run(b, m, duration_s=5.0, payload=0.5 * unit.design.payload[1], start=0,
                        gravity_phase=0.3, modern=half == "final", finer=finer)  # fmt: skip
                return r.out_nm[round(1.0 / DT) :]

            a, c = torque(1), torque(4)
            out.append(float(np.std(a - c) / np.std(c)))
        print(f"  step {axis:10s} torque error normal {out[0]:.4f}, play {out[1]:.4f} of its RMS")


def auc(pos: Floats, neg: Floats) -> float:
    """Chance that a positive is above a negative."""
    d = pos[:, None] - neg[None, :]
    return float(np.mean(d > 0) + 0.5 * np.mean(d == 0))


def lda(train: Floats, y: Floats, test: Floats) -> Floats:
    """Classes 0.. of the test rows by linear discriminants with a common covariance."""
    mu, sd = train.mean(0), train.std(0) + 1e-9
    a, b = (train - mu) / sd, (test - mu) / sd
    means = np.array([a[y == c].mean(0) for c in range(int(y.max()) + 1)])
    res = a - means[y.astype(int)]
    inv = np.linalg.inv(np.cov(res.T) + 0.2 * np.eye(a.shape[1]))
    score = b @ inv @ means.T - 0.5 * np.sum(means @ inv * means, axis=1)
    return np.argmax(score, axis=1)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m tests.stranger_bank.check")
    parser.add_argument("--half", choices=["work", "final"], required=True)
    parser.add_argument("--out", required=True)
    args = parser.parse_args()
    bank.use_folder(args.out)
    half: Half = args.half
    convergence(half)
    sets = bank.questions(half)
    for axis in DESIGNS[half]:
        lib = bank.library(half, axis, 6)
        known = [r for q in sets if q.name.startswith(f"known/{axis}/") for r in q]
        rows = lib + known
        states = np.array(["+".join(sorted(r.labels)) for r in rows])
        cf = np.array([crest(r.samples.astype(float)) for r in rows])
        feats = np.array([features(r) for r in rows])
        gear = np.array([r.gearbox for r in rows])
        print(f"{half} {axis}: {len(rows)} recordings")
        for s in ("normal", "notch", "play"):
            k = states == s
            aud = [
                [r.audibility_low_db, r.audibility_db, r.audibility_peak_db]
                for r in np.array(rows, object)[k]
                if s != "normal"
            ]
            text = "" if s == "normal" else f"audible low/full/peak {np.median(aud, axis=0).round(1)}"
            q = np.percentile(cf[k], [10, 50, 90]).round(1)
            low = np.median(feats[k, 7])
            print(f"  {s:7s} crest {q}, low band {low:5.1f} dB to 200-800 Hz {text}")
        for s in ("notch", "play"):
            hits = []
            for r in rows:
                if r.labels == {s} and (r.audibility_peak_db or -99) > 10:
                    marks = r.events_s if s == "notch" else r.landings_s
                    hits.append(at_marks(r, marks, 0.12))
            if hits:
                h = np.mean(hits, axis=0)
                print(f"  {s}: {h[0]:.2f} of loudest low frames at true times, chance {h[1]:.2f}"
                      f" ({len(hits)} recordings)")  # fmt: skip
        bumps = np.array([after(r, r.landings_s) for r in rows])
        k = (states == "play") & np.array([(r.audibility_peak_db or -99) > 8 for r in rows])
        n0, p0 = bumps[states == "normal"], bumps[k]
        print(
            f"  low band after reversals over its median: normal {np.nanmedian(n0):.1f} dB,"
            f" heard play {np.nanmedian(p0):.1f} dB,"
            f" AUC {auc(p0[np.isfinite(p0)], n0[np.isfinite(n0)]):.2f}"
        )
        k = (states == "notch") & np.array([(r.audibility_peak_db or -99) > 8 for r in rows])
        n1 = np.array([after(r, r.events_s) for r in np.array(rows, object)[k]])
        print(f"  low band at the notch over its median: heard notch {np.nanmedian(n1):.1f} dB")
        heard = np.array([(r.audibility_peak_db or -99) > 8 for r in rows])
        normal = states == "normal"
        for s in ("notch", "play"):
            k = (states == s) & heard
            a = [auc(feats[k, i], feats[normal, i]) for i in range(feats.shape[1])]
            print(f"  {s} heard ({k.sum()}) against normal: best single feature AUC {max(a):.2f},"
                  f" low peak {a[0]:.2f}")  # fmt: skip
        for what, k in (("all sizes", np.ones(len(rows), bool)), ("heard", normal | heard)):
            y = np.searchsorted(["normal", "notch", "play"], states)
            if min(np.sum(k & (states == s)) for s in ("notch", "play")) < 8:
                continue  # too few to learn from
            right = []
            for g in np.unique(gear):
                te, tr = (gear == g) & k, (gear != g) & k
                right.append(lda(feats[tr], y[tr], feats[te]) == y[te])
            yk = np.concatenate([y[(gear == g) & k] for g in np.unique(gear)])
            ok = np.concatenate(right)
            per = [round(float(np.mean(ok[yk == c])), 2) for c in range(3)]
            print(f"  leave one gearbox out, {what}: normal/notch/play right {per}")
    for q in sets:
        if q.name.startswith(("unseen/", "two/")):
            a = np.array([[r.audibility_low_db, r.audibility_db, r.audibility_peak_db] for r in q])
            c = np.median([crest(r.samples.astype(float)) for r in q])
            mute = np.sum((a[:, 0] < -20) & (a[:, 1] < -20) & (a[:, 2] < 3))
            print(f"  {q.name:32s} low/full/peak dB {np.median(a, axis=0).round(1)} crest {c:.1f}"
                  f" mute {mute}/{len(q)}")  # fmt: skip


if __name__ == "__main__":
    main()
