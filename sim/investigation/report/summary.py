"""What page and report show of an investigation: panels of model and measurement, and the candidates that were weighed.

Overlay and residual are always two panels over one axis, with the noise floor of the measurement; the residual is then
sorted by angle, order, speed, load, direction and time, because where it lives says what it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim import mechanisms
from sim.investigation.assessment.posterior import is_close
from sim.investigation.estimation.estimate import Fit
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.report.acoustic_panels import along_path, sound_candidates, sound_panels
from sim.investigation.report.cause_panels import cause_panels
from sim.investigation.report.checks import checked
from sim.investigation.report.formatting import named
from sim.investigation.report.panels import Panel
from sim.investigation.report.residual_panels import overlay_panels, residual_panels
from sim.investigation.report.wording import headline, not_examined
from sim.investigation.search.criterion import BEYOND, evidence, form_share, matters
from sim.investigation.search.proposals import Rival
from sim.investigation.search.search import Selection

if TYPE_CHECKING:
    from sim.investigation.results import Investigation

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
        }


def story(result: Investigation) -> dict[str, object]:
    """Headline, checks, panels and candidates as JSON."""
    overlay, residual, sound = panels(result)
    return {
        "headline": headline(result),
        "checked": [{"check": check, "result": told} for check, told in checked(result)],
        "not_examined": not_examined(result),
        "causes": [{"finding": place, **panel.document()} for place, panel in enumerate(cause_panels(result)) if panel],
        "overlay": [panel.document() for panel in overlay],
        "residual": [panel.document() for panel in residual],
        "sound": [panel.document() for panel in sound],
        "candidates": [candidate.document() for candidate in candidates(result)],
    }


def panels(result: Investigation) -> tuple[list[Panel], list[Panel], list[Panel]]:
    """Model and measurement; what is left, by where it lives; what was heard beside telemetry."""
    if result.selection is not None and result.gate is not None:
        overlay = overlay_panels(result.selection, result.gate.measurement.torque)
        return overlay, residual_panels(result.selection), along_path(result)
    if result.listening is None:
        return list(result.encoders), [], []
    return (*sound_panels(result.listening), [])


def candidates(result: Investigation) -> list[Candidate]:
    """What was weighed and not named, what was tried in place of a finding first."""
    if result.selection is None:
        found = sound_candidates(result.listening) if result.listening else ()
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
    silent = [Candidate(name, None, reason) for name, reason in unheard(result)]
    return [*instead, *as_new, *(_left_out(selection, rival) for rival in rest[:MOST_CANDIDATES]), *silent]


def unheard(result: Investigation) -> list[tuple[str, str]]:
    """What was listened for beside telemetry and not heard, and why."""
    named = {finding.mechanism for finding in result.findings}
    silent = ((name, kind.heard.silent) for name, kind in mechanisms.MECHANISMS.items() if kind.heard)
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
    elif rival.beyond <= 0.0:
        reason = "Its best-fitting size is no larger than in a new axis, or too small to matter."
    elif rival.gain < needed:
        reason = "It explains less than is needed for one more mechanism."
    elif rival.beyond <= BEYOND:
        reason = (
            f"Its best-fitting size is only {rival.beyond:.1f} standard deviations above that of a new axis or what "
            f"matters; {BEYOND:g} are needed."
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
        enough = matters(term, middle, fit) and evidence(term, middle / noise, rows) > 0.0
        low, high = (low, middle) if enough else (middle, high)
    return high


def _form_of(selection: Selection, rival: Rival) -> str | None:
    """The mechanism whose errors of form a candidate may be."""
    for key, gain in selection.gains.items():
        if rival.gain < form_share(rival.term.mechanism, key.mechanism) * gain:
            return key.mechanism
    return None
