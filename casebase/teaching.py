"""What a case teaches the library: its cross-validation without the case and with it, on the same recordings."""

from collections.abc import Callable
from dataclasses import dataclass

from casebase.reasoning.evaluation import Evaluation, Outcome, Proportion


@dataclass(frozen=True)
class Change:
    """A recording that was held out and is answered otherwise with the case."""

    before: Outcome
    after: Outcome


@dataclass(frozen=True)
class Figure:
    """A share of the same recordings, without the case and with it."""

    before: Proportion
    after: Proportion


@dataclass(frozen=True)
class Teaching:
    """What a case changes.

    Args:
        right: recordings whose answer is their label.
        said: of those called `diagnosed`, how many were right.
        called_new: recordings of known kinds called `not_in_library`.
        changes: recordings whose verdict or most probable label is another with the case, the wrong ones first.
        own: what is said of the case itself, with its gearbox held out; None where it is not among those held out.
    """

    right: Figure
    said: Figure
    called_new: Figure
    changes: tuple[Change, ...]
    own: Outcome | None

    @property
    def better(self) -> int:
        """How many answers became right."""
        return sum(each.after.right and not each.before.right for each in self.changes)

    @property
    def worse(self) -> int:
        """How many answers were right before and are not now."""
        return sum(each.before.right and not each.after.right for each in self.changes)


def teaching(without: Evaluation, having: Evaluation, case_id: str) -> Teaching:
    """Compare two cross-validations on the recordings that both held out.

    Args:
        without: of the library without the case.
        having: of the library with it.
    """
    before = {each.case_id: each for each in without.outcomes if each.case_id != case_id}
    after = {each.case_id: each for each in having.outcomes}
    pairs = [Change(each, after[identity]) for identity, each in before.items() if identity in after]
    changed = [
        each for each in pairs if (each.before.verdict, each.before.best) != (each.after.verdict, each.after.best)
    ]
    changed.sort(key=lambda each: (each.after.right, each.after.case_id))

    def figure(counts: Callable[[Outcome], bool], of: Callable[[Outcome], bool] = lambda _: True) -> Figure:
        return Figure(
            _share([each.before for each in pairs], counts, of), _share([each.after for each in pairs], counts, of)
        )

    return Teaching(
        figure(lambda one: one.right),
        figure(lambda one: one.right, lambda one: one.verdict == "diagnosed"),
        figure(lambda one: one.verdict == "not_in_library"),
        tuple(changed),
        after.get(case_id),
    )


def _share(outcomes: list[Outcome], counts: Callable[[Outcome], bool], of: Callable[[Outcome], bool]) -> Proportion:
    asked = [each for each in outcomes if of(each)]
    return Proportion(sum(counts(each) for each in asked), len(asked))
