"""What page and report show of an investigation: panels of model and measurement, and the candidates that were weighed.

Overlay and residual are always two panels over one axis, with the noise floor of the measurement; the residual is then
sorted by angle, order, speed, load, direction and time, because where it lives says what it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sim import mechanisms
from sim.investigation.assessment.posterior import is_close
from sim.investigation.estimation.estimate import Fit
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.report.acoustic_panels import along_path, sound_candidates, sound_panels
from sim.investigation.report.cause_panels import cause_panel, cause_panels
from sim.investigation.report.checks import checked
from sim.investigation.report.formatting import likely, named
from sim.investigation.report.panels import Panel
from sim.investigation.report.residual_panels import overlay_panels, residual_panels
from sim.investigation.report.wording import headline, not_examined
from sim.investigation.search.criterion import LEAST_EFFECT, evidence, exceeds_model_error, form_share
from sim.investigation.search.proposals import Rival
from sim.investigation.search.search import Selection

if TYPE_CHECKING:
    from sim.investigation.pooling.joint_investigation import Together
    from sim.investigation.pooling.pooled_estimates import Part
    from sim.investigation.results import Finding, Investigation

MOST_CANDIDATES = 12
ALIKE = "In these data it looks the same as what was named."
LARGEST = 1e9  # of squares that a term may be asked for
HALVINGS = 60


@dataclass(frozen=True)
class Candidate:
    """A mechanism that was weighed and not named.

    `explains`, `needed`: drop of the squared residual in units of its noise, and the least for which one more mechanism
    is worth its place; `instead_of`: the one that it was tried in place of, and by how many standard errors it predicts
    unseen blocks worse (`behind`). None where that was not asked.
    """

    mechanism: str
    location: str | None
    reason: str
    explains: float | None = None
    needed: float | None = None
    instead_of: str | None = None
    behind: float | None = None

    def document(self) -> dict[str, object]:
        """JSON."""
        return {
            "mechanism": self.mechanism,
            "location": self.location,
            "explains": None if self.explains is None else round(self.explains, 1),
            "needed": None if self.needed is None else round(self.needed, 1),
            "instead_of": self.instead_of,
            "behind": None if self.behind is None else round(self.behind, 2),
            "reason": self.reason,
            "alike": self.reason == ALIKE,
        }


def story(result: Investigation, causes: Sequence[Panel | None] | None = None) -> dict[str, object]:
    """Headline, checks, panels and candidates as JSON.

    `causes`: a plot of each finding, where the caller has others than `cause_panels`.
    """
    overlay, residual, sound = panels(result)
    causes = cause_panels(result) if causes is None else causes
    selection = result.selection
    return {
        "headline": headline(result),
        "measured": "encoders" if result.encoders else "sound" if selection is None else "torque",
        "linear": selection is not None and not result.axis.stages,
        "load_encoder": bool(result.encoders) or (selection is not None and selection.problem.guided),
        "misfit": None if selection is None else selection.fit.misfit / selection.fit.residual.size,
        "found": [] if selection is None else [_taken(selection, term) for term in selection.found],
        "checked": [{"check": check, "result": told} for check, told in checked(result)],
        "not_examined": not_examined(result),
        "causes": [{"finding": place, **panel.document()} for place, panel in enumerate(causes) if panel],
        "overlay": [panel.document() for panel in overlay],
        "residual": [panel.document() for panel in residual],
        "sound": [panel.document() for panel in sound],
        "candidates": [candidate.document() for candidate in candidates(result)],
    }


def _taken(selection: Selection, term: Term) -> dict[str, object]:
    """What a mechanism that came in explains, and what it had to."""
    explains, needed = selection.gains[term.key], asked_for(term, selection.fit)
    return {
        "mechanism": term.mechanism, "location": term.location, "explains": round(explains, 1),
        "needed": round(needed, 1),
    }  # fmt: skip


def panels(result: Investigation) -> tuple[list[Panel], list[Panel], list[Panel]]:
    """Model and measurement; what is left, by where it lives; what was heard beside telemetry."""
    if result.selection is not None and result.data_check is not None:
        overlay = overlay_panels(result.selection)
        return overlay, residual_panels(result.selection), along_path(result)
    if result.acoustic is None:
        return list(result.encoders), [], []
    return (*sound_panels(result.acoustic), [])


def candidates(result: Investigation) -> list[Candidate]:
    """What was weighed and not named, what was tried in place of a finding first."""
    if result.selection is None:
        found = sound_candidates(result.acoustic) if result.acoustic else ()
        return [Candidate(name, None, reason) for name, reason in found]
    selection = result.selection
    present = {term.key for term in selection.fit.terms}
    instead = [
        _instead(term, other, behind)
        for term in selection.found
        for other, behind in selection.standings[term.key].rivals
        if other.key not in present
    ]
    told = {(c.mechanism, c.location) for c in instead}
    rest = [r for r in selection.rejected if r.term.key not in present]
    rest = [r for r in rest if (r.term.mechanism, r.term.location) not in told]
    as_new = [
        Candidate(
            t.mechanism, t.location, "It is in the model, but no larger than in a new axis or too small to matter."
        )
        for t in selection.fit.terms
        if t.named and t not in selection.found
    ]
    silent = [Candidate(name, None, reason) for name, reason in not_detected(result)]
    return [*instead, *as_new, *(_left_out(selection, rival) for rival in rest[:MOST_CANDIDATES]), *silent]


def not_detected(result: Investigation) -> list[tuple[str, str]]:
    """What was listened for beside telemetry and not heard, and why."""
    named = {finding.mechanism for finding in result.findings}
    silent = ((name, kind.sound.absent) for name, kind in mechanisms.MECHANISMS.items() if kind.sound)
    return [(name, why) for name, why in silent if why and result.sounds and name not in named]


def _instead(term: Term, other: Term, behind: float) -> Candidate:
    reason = (
        ALIKE if is_close(behind) else "In place of what was named it predicts rows not used for the fit less well."
    )
    return Candidate(other.mechanism, other.location, reason, instead_of=term.mechanism, behind=behind)


def _left_out(selection: Selection, rival: Rival) -> Candidate:
    """A mechanism that was tried on top of all others: what it explains, and why that is not enough."""
    fit, term = selection.fit, rival.term
    needed = asked_for(term, fit)
    other = _form_of(selection, rival)
    if rival.gain <= 0:
        reason = "It explains nothing beyond the others."
    elif rival.effect_size <= 0.0:
        reason = "Its best-fitting size is no larger than in a new axis, or too small to matter."
    elif rival.gain < needed:
        reason = "It explains less than is needed for one more mechanism."
    elif rival.effect_size <= LEAST_EFFECT:
        reason = (
            f"Its best-fitting size is only {rival.effect_size:.1f} standard deviations above that of a new axis or "
            f"what matters; {LEAST_EFFECT:g} are needed."
        )
    elif other is not None:
        reason = f"It is so small beside {named(other)} that it may only be an error in how that is modelled."
    else:
        reason = (
            "It did not improve the prediction of rows not used for the fit, or another mechanism explains the same."
        )
    return Candidate(term.mechanism, term.location, reason, max(rival.gain, 0.0), needed)


def asked_for(term: Term, fit: Fit) -> float:
    """Least drop of the squared residual, in units of its noise, for which `term` is worth a place beside `fit`."""
    rows = fit.residual.size
    noise = max(1.0, fit.misfit / rows)
    low, high = 0.0, LARGEST
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = exceeds_model_error(term, middle, fit) and evidence(term, middle / noise, rows) > 0.0
        low, high = (low, middle) if enough else (middle, high)
    return high


def _form_of(selection: Selection, rival: Rival) -> str | None:
    """The mechanism whose errors of form a candidate may be."""
    for key, gain in selection.gains.items():
        if rival.gain < form_share(rival.term.mechanism, key.mechanism) * gain:
            return key.mechanism
    return None


def story_together(result: Together) -> dict[str, object]:
    """Headline, and the plots of what was found, as JSON."""
    shown = enumerate(cause_panels_together(result))
    return {
        "headline": headline(result.combined),
        "causes": [{"finding": place, **panel.document()} for place, panel in shown if panel],
    }


def cause_panels_together(result: Together) -> list[Panel | None]:
    """The plot of every finding, of the recording that shows it most surely."""
    return [_clearest(result, finding) for finding in result.combined.findings]


def _clearest(result: Together, finding: Finding) -> Panel | None:
    same = [
        (one.probability, part, one)
        for part in result.parts
        for one in part.result.findings
        if (one.mechanism, one.location) == (finding.mechanism, finding.location)
    ]
    if not same:
        return None
    _, part, one = max(same, key=lambda each: each[0])
    panel = cause_panel(part.result, one)
    return panel and replace(panel, title=f"{panel.title}, in {part.recording.name}")


def parts_together(result: Together) -> list[tuple[str, dict[str, object]]]:
    """Each recording by itself: its title, and its document with its story."""
    return [(_title(part), {**part.result.document(), "story": story(part.result)}) for part in result.parts]


def _title(part: Part) -> str:
    sound = f" with {part.recording.sound_name}" if part.recording.sound_name else ""
    found = ", ".join(
        f"{named(f.mechanism, f.location)}, {likely(f.probability, calibrated=f.calibrated)}"
        for f in part.result.findings
    )
    return f"{part.recording.name}{sound}: {found or headline(part.result)}"
