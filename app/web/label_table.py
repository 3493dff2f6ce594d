"""Labels and mechanisms beside each other, with the names that damage of teeth has in ISO 10825-1."""

from collections.abc import Mapping
from dataclasses import dataclass

from casebase.labels import BASELINES, GEAR_DAMAGE
from sim.discrepancy.report.formatting import named
from sim.experiment.design_of_experiments import LABELS, labels
from sim.mechanisms import MECHANISMS

Counts = Mapping[tuple[str, str], int]


@dataclass(frozen=True)
class LabelRow:
    """A label or a mechanism: what it is, its name in ISO 10825-1 (empty where it has none), its cases.

    `label` is empty where sound does not show the mechanism, so that no recording can have it as a label.
    """

    label: str
    mechanism: str
    what: str
    damage: str
    measured: int
    simulated: int
    can_be_simulated: bool


def mechanism_rows(counts: Counts) -> list[LabelRow]:
    """Every mechanism of the catalogue, the labels of cases first."""
    of_label = {kind or "": label for label, kind in LABELS.items()}
    heard = set(labels())
    rows = []
    for name, kind in MECHANISMS.items():
        label = of_label.get(name, name if name in heard else "")
        what = " ".join((kind.__doc__ or "").split("\n")[0].split())
        rows.append(_row(label, named(name), what, kind.damage, counts, can_be_simulated=bool(label)))
    return sorted(rows, key=lambda row: (row.label not in LABELS, not row.label))


def other_rows(counts: Counts) -> list[LabelRow]:
    """Labels that are no mechanism: damage that is seen on teeth, and what the library has besides."""
    known = {*labels(), *GEAR_DAMAGE}
    own = sorted({label for label, _ in counts if label not in known and label not in BASELINES})
    return [_row(label, "", "", GEAR_DAMAGE.get(label, ""), counts) for label in (*GEAR_DAMAGE, *own)]


def damage_of(label: str | None) -> str:
    """Return what ISO 10825-1 calls a label, or the damage that can make it; empty where it has no name for it.

    >>> damage_of("pitting"), damage_of("normal")
    ('surface fatigue: pitting', '')
    """
    name = LABELS.get(label or "", label) or ""
    return MECHANISMS[name].damage if name in MECHANISMS else GEAR_DAMAGE.get(name, "")


def _row(
    label: str, mechanism: str, what: str, damage: str, counts: Counts, *, can_be_simulated: bool = False
) -> LabelRow:
    measured, simulated = (counts.get((label, origin), 0) for origin in ("measured", "simulated"))
    return LabelRow(label, mechanism, what, damage, measured, simulated, can_be_simulated)
