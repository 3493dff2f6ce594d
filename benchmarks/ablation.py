"""What each family of features brings: labels of unseen gearboxes with all of them, and without one after the other.

Strangers' recordings (`benchmarks.strangers`, half work: four axes, eight motions) by libraries of two and of six
gearboxes, audible faults alone, and the shared recordings of another axis, leave one gearbox out. The label that
leads counts, however probable it is.
"""

from collections.abc import Collection, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks import Row
from benchmarks.diagnosis import SHARED, answers, axis_table, said
from benchmarks.strangers import audible, heard, reasoner
from casebase.signals.features import FEATURES, Extraction, FeatureVector
from tests import stranger_bank as bank
from tests.stranger_bank.bank import Spec, library_specs

GEARBOXES = (2, 6)
Heard = dict[Spec, tuple[bank.Recorded, Extraction]]


def families() -> dict[str, frozenset[str]]:
    """Return the names of the features of every family that is compared."""
    known = {type(each).__name__: each.definitions for each in FEATURES}
    named = {family: frozenset(each.name for each in entries if each.compared) for family, entries in known.items()}
    return {family: names for family, names in named.items() if names}


def without(values: NDArray[np.float32], names: Sequence[str], dropped: Collection[str]) -> NDArray[np.float32]:
    """Return values of shape (..., n), NaN in the columns that are dropped."""
    found = values.copy()
    found[..., [name in dropped for name in names]] = np.nan
    return found


def strangers(found: Heard, dropped: Collection[str], gearboxes: int) -> str:
    """Return how many audible recordings of known kinds get the right label, each by a library of its own axis."""
    right = of = 0
    for axis in bank.DESIGNS["work"]:
        known = [_less(found[spec], dropped) for spec in library_specs("work", axis, gearboxes)]
        judging = reasoner(known)
        for asked in bank.questions("work"):
            for spec in asked.specs if asked.name.startswith(f"known/{axis}/") else ():
                truth, extraction = _less(found[spec], dropped)
                if audible(truth):
                    judgement = judging.judge(extraction.features.values)
                    right += judgement.best.label in truth.labels
                    of += 1
    return f"{gearboxes} gearboxes {said(right, of)}"


def _less(case: tuple[bank.Recorded, Extraction], dropped: Collection[str]) -> tuple[bank.Recorded, Extraction]:
    features = case[1].features
    fewer = FeatureVector(features.names, without(features.values, features.names, dropped))
    return case[0], replace(case[1], features=fewer)


def shared(dropped: Collection[str]) -> str:
    """Return how many of the shared recordings get the right label."""
    if not SHARED.exists():
        return "the measured data are not here"
    table = axis_table()
    less = replace(table, values=without(table.values, table.names, dropped))
    found = answers(less, less)
    return f"shared {sum(truth == best for truth, best, _ in found)} of {len(found)}"


def run() -> list[Row]:
    """Return one row for all families and one without each."""
    specs = [spec for asked in bank.questions("work") if asked.name.startswith("known/") for spec in asked.specs]
    specs += [spec for axis in bank.DESIGNS["work"] for spec in library_specs("work", axis, max(GEARBOXES))]
    specs = list(dict.fromkeys(specs))
    with ProcessPoolExecutor() as pool:
        found: Heard = dict(zip(specs, pool.map(heard, specs, chunksize=16), strict=True))
    rows = []
    for name, dropped in {"all": frozenset[str](), **{f"without {k}": v for k, v in families().items()}}.items():
        parts = [*(strangers(found, dropped, count) for count in GEARBOXES), shared(dropped)]
        rows.append(Row(name, 0.0, note="; ".join(parts)))
    return rows
