"""What an investigation finds: estimates, findings, gain, what stays unexplained; and its document."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sim.investigation.unexplained import Unexplained, rounded, unexplained_document

if TYPE_CHECKING:  # a page that shows a document needs none of what found it
    from signals.recording import Recording
    from sim.description.axis import Axis
    from sim.investigation.acoustic.evidence import AcousticResult
    from sim.investigation.assessment.posterior import Evidence
    from sim.investigation.data.validation import DataCheck
    from sim.investigation.report.panels import Panel
    from sim.investigation.search.search import Selection

REPORTED = 0.5  # probability from which a name is said


@dataclass(frozen=True)
class Gain:
    """Root mean square of what a model leaves in a channel, of held-out rows in motion, before and after."""

    channel: str
    unit: str
    rms_before: float
    rms_after: float
    significant: bool
    rms_measured: float


@dataclass(frozen=True)
class Estimate:
    """One number with its 90 % interval."""

    name: str
    value: float
    unit: str
    low: float
    high: float
    nominal: float | None = None


@dataclass(frozen=True)
class Finding:
    """A mechanism that the description lacks and the data ask for."""

    mechanism: str
    location: str | None
    probability: float
    parameters: tuple[Estimate, ...]
    indistinguishable_from: tuple[str, ...]
    explanation: str
    evidence: Evidence | None = None
    elsewhere: tuple[str, ...] = ()  # places at which the data would be the same
    action: str = ""
    as_new_too: bool = False  # the interval of its size holds what a new axis has
    lacks: tuple[str, ...] = ()  # what the record would have to have for the name to be told from others

    @property
    def calibrated(self) -> bool:
        """Whether its probability was calibrated: that of one telemetry's selection, of nothing else."""
        return self.evidence is not None


class Limit(str):
    """A remark that limits every finding, and stands beside them."""


@dataclass(frozen=True)
class Investigation:
    """What the simulation gets wrong, why, and what the extension gained; `document()` is the contract's JSON."""

    axis: Axis
    verdict: str
    findings: tuple[Finding, ...]
    unexplained: Unexplained | None
    parameters: tuple[Estimate, ...]
    gain: tuple[Gain, ...]
    next_measurement: str
    extended: Axis
    provenance: Mapping[str, object]
    rejected: tuple[tuple[str, float], ...] = ()
    remarks: tuple[str, ...] = ()
    next_measurements: tuple[MeasurementUtility, ...] = ()
    selection: Selection | None = field(default=None, repr=False, compare=False)
    acoustic: AcousticResult | None = field(default=None, repr=False, compare=False)
    data_check: DataCheck | None = field(default=None, repr=False, compare=False)
    sounds: tuple[Recording, ...] = field(default=(), repr=False, compare=False)
    sound_offset_s: float = 0.0
    weighed: Selection | None = field(default=None, repr=False, compare=False)
    """As it was weighed, before the last fit of `final_fit`: what another recording found is held against this."""
    encoders: tuple[Panel, ...] = field(default=(), repr=False, compare=False)
    """What two encoders show where no torque was given, and so no model was fitted."""

    @property
    def examined(self) -> tuple[str, ...]:
        """Mechanisms that sound alone let be looked for; empty with telemetry, by which `rejected` tells."""
        return () if self.acoustic is None else self.acoustic.examined

    @property
    def not_examined(self) -> Mapping[str, str]:
        """Mechanisms that sound alone did not let be looked for, to the reason; empty with telemetry."""
        return {} if self.acoustic is None else self.acoustic.not_examined

    def document(self) -> dict[str, object]:
        """JSON of the contract: finite numbers only, the same for the same bytes."""
        return {
            "verdict": self.verdict,
            "findings": [finding_document(f) for f in self.findings],
            "unexplained": None if self.unexplained is None else unexplained_document(self.unexplained),
            "parameters": [estimate_document(e) for e in self.parameters],
            "gain": [gain_document(g) for g in self.gain],
            "next_measurement": self.next_measurement,
            "next_measurements": [told.document() for told in self.next_measurements],
            "extended_axis": self.extended.to_mapping(),
            "rejected": [{"mechanism": name, "gain": rounded(gain)} for name, gain in self.rejected],
            "remarks": list(self.remarks),
            "limits": [one for one in self.remarks if isinstance(one, Limit)],
            "provenance": dict(self.provenance),
            **({} if self.acoustic is None else
               {"examined": list(self.examined), "not_examined": dict(self.not_examined)}),
        }  # fmt: skip


def estimate_document(e: Estimate) -> dict[str, object]:
    """JSON of a number of the description."""
    return {
        "name": e.name,
        "nominal": None if e.nominal is None else rounded(e.nominal),
        "estimate": rounded(e.value),
        "low": rounded(e.low),
        "high": rounded(e.high),
        "unit": e.unit,
    }


def gain_document(g: Gain) -> dict[str, object]:
    """JSON of what a channel gained."""
    return {
        "channel": g.channel,
        "unit": g.unit,
        "rms_before": rounded(g.rms_before),
        "rms_after": rounded(g.rms_after),
        "held_out": True,
        "distinguishable_from_zero": g.significant,
        "rms_measured": rounded(g.rms_measured),
    }


def finding_document(f: Finding) -> dict[str, object]:
    """JSON of a finding."""
    return {
        "mechanism": f.mechanism,
        "location": f.location,
        "probability": round(f.probability, 4),
        "calibrated": f.calibrated,
        "parameters": [
            {"name": e.name, "value": rounded(e.value), "unit": e.unit, "low": rounded(e.low), "high": rounded(e.high)}
            for e in f.parameters
        ],
        "indistinguishable_from": list(f.indistinguishable_from),
        "explanation": f"{f.explanation} {f.action}".strip(),
        "action": f.action,
        **({"elsewhere": list(f.elsewhere)} if f.elsewhere else {}),
    }


@dataclass(frozen=True)
class Difference:
    """Where two models differ most once each is adapted to the other: in which channel, by how much [N m] (rms), at
    which speeds of the load [rad/s]. `more`: 1 where the first asks for more torque along the motion, -1 the second."""

    channel: str
    torque_n_m: float
    low: float
    high: float
    more: int


@dataclass(frozen=True)
class MeasurementUtility:
    """What a measurement would tell of two causes.

    `separation`: whitened squares that either leaves of the other's data, beyond what the other leaves itself, the
    smaller of the two (where one is the other with something more, what the lesser leaves); `repeat`: the same of a
    repeat of the present motion; `effort`: a repeat is 1; `worth`: what the measurement tells of all rivals for that,
    where more than `ENOUGH` is no better.
    """

    text: str
    between: tuple[str, str]
    separation: float
    repeat: float
    effort: float
    worth: float
    difference: Difference

    def document(self) -> dict[str, object]:
        """JSON."""
        return {
            "text": self.text,
            "between": list(self.between),
            "separation": digits(self.separation),
            "repeat": digits(self.repeat),
            "effort": self.effort,
        }


def digits(squares: float) -> float:
    """Three digits and no less than hundredths: what two runs agree on whatever the order of a sum.

    >>> digits(1057.83), digits(7.2e-5)
    (1060.0, 0.0)
    """
    return round(float(f"{squares:.3g}"), 2)
