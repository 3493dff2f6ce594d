"""Documents that earlier versions stored, completed as they are read: the one place that knows what those lacked.

A document stays in the database as it was written. A field that is new gets its line here, with what is right for a
document from before it was: not looked for, not known, none.
"""

from collections.abc import Mapping
from typing import Any

from casebase.labels import BASELINES, PARAMETERS

Document = dict[str, Any]


def diagnosis_document(stored: Mapping[str, Any]) -> Document:
    """Return a diagnosis with every field that is read today.

    >>> old = diagnosis_document({"verdict": "diagnosed", "label": "notch", "probability": 0.8})
    >>> old["severity"], old["faults"], old["recording"]["same_as_case"]
    (None, [{'label': 'notch', 'probability': 0.8}], None)
    """
    label, probability = stored.get("label"), stored.get("probability")
    named = label is not None and label not in BASELINES
    return {
        "verdict": "unusable",
        "label": None,
        "probability": None,
        "hypotheses": [],
        "neighbours": [],
        "faults": [{"label": label, "probability": probability}] if named else [],
        "evidence": [],
        "remarks": [],
        "severity": None,
        "detection_limit": dict.fromkeys(PARAMETERS),
        "disturbances": [],
        **stored,
        "quality": [{"start_s": None, "end_s": None, **flag} for flag in stored.get("quality", ())],
        "novelty": {"distance": None, "threshold": None, **stored.get("novelty", {})},
        "recording": {"same_as_case": None, **stored.get("recording", {})},
        "provenance": dict(stored.get("provenance", {})),
    }


def investigation_document(stored: Mapping[str, Any]) -> Document:
    """Return an investigation with every field that is read today.

    >>> investigation_document({"verdict": "unnamed"})["findings"]
    []
    """
    finding: Document = {"location": None, "parameters": [], "indistinguishable_from": [], "explanation": ""}
    parameter: Document = {"nominal": None, "unit": ""}
    return {
        "unexplained": None,
        "next_measurement": "",
        "extended_axis": {},
        "remarks": [],
        "rejected": [],
        "provenance": {},
        "story": {},
        **stored,
        "findings": [{**finding, **one} for one in stored.get("findings", ())],
        "parameters": [{**parameter, **one} for one in stored.get("parameters", ())],
        "gain": [{"unit": "", "held_out": False, **one} for one in stored.get("gain", ())],
    }
