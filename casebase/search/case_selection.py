"""Which cases count for a recording of an axis: its own, and those of other axes where they help.

Measured cases of the axis count, and simulated ones for the labels that were not measured at it. Whether cases of
other axes are like it is measured: they count if the axis' own cases, left out by gearbox, are more probable with them.
What is novel at an axis is judged by its own cases, where they know every label: axes differ by more than gearboxes do.
"""

import numpy as np

from casebase.reasoning.classifier import Classifier
from casebase.search.case_table import CaseTable, Mask

FEWEST_OWN = 6


def fitted(table: CaseTable, axis: str | None) -> Classifier | None:
    """Return a classifier of the cases that count for an axis; None where they have fewer than two labels.

    Args:
        axis: None where it is not known; then all axes count alike.
    """
    here = _of_axis(table, axis)
    own, everything = _measured_first(table, here), _measured_first(table, here) | _measured_first(table, ~here)
    alone = _classifier(table, own) if _tell_apart(table, own) else None
    if alone is not None and (own == everything).all():
        return alone
    together = _classifier(table, everything)
    if alone is None or together is None:
        return together
    losses = [_loss(table, each, own) for each in (alone, together)]
    return alone if losses[0] <= losses[1] else together


def compared(table: CaseTable, axis: str | None, counting: Mask) -> Mask:
    """Return the cases by which novelty is judged at an axis, shape (cases,).

    Args:
        counting: which cases its classifier counts.
    """
    own = _measured_first(table, _of_axis(table, axis))
    return own if _tell_apart(table, own) else counting


def _of_axis(table: CaseTable, axis: str | None) -> Mask:
    return np.asarray(table.axes == axis) if axis is not None else np.zeros(len(table), np.bool_)


def _measured_first(table: CaseTable, among: Mask) -> Mask:
    """Return the measured ones of some cases, and the simulated ones of labels that were not measured among them."""
    measured = among & (table.origins == "measured")
    return np.asarray(measured | (among & ~np.isin(table.labels, table.labels[measured])))


def _tell_apart(table: CaseTable, rows: Mask) -> bool:
    """Whether these cases know every label of the library, two of each and of two gearboxes."""
    of_label = [np.unique(table.groups[rows & (table.labels == label)]).size for label in table.classes]
    return int(np.count_nonzero(rows)) >= FEWEST_OWN and min(of_label) >= 2


def _classifier(table: CaseTable, rows: Mask) -> Classifier | None:
    return Classifier(table, np.flatnonzero(rows)) if np.unique(table.labels[rows]).size > 1 else None


def _loss(table: CaseTable, classifier: Classifier, own: Mask) -> float:
    """Return minus the mean log likelihood of an axis' own cases, left out."""
    losses = classifier.held_out.losses()[own[classifier.held_out.rows]]
    return float(losses.mean()) if losses.size else np.inf
