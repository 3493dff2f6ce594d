"""What stays unexplained: where the residual lives, and its document."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Unexplained:
    """Where the residual lives; `share` of its whitened energy above the noise, `score` in standard deviations."""

    kind: str
    channel: str
    share: float
    score: float
    numbers: Mapping[str, float]


def unexplained_of(document: Mapping[str, Any]) -> Unexplained:
    """Read back what `unexplained_document` wrote."""
    told = {"kind", "channel", "share", "score", "joint"}
    numbers = {name: float(value) for name, value in document.items() if name not in told}
    return Unexplained(
        document["kind"], document["channel"], float(document["share"]), float(document.get("score", 0.0)), numbers
    )


def unexplained_document(u: Unexplained) -> dict[str, object]:
    """JSON of what stays unexplained."""
    return {
        "kind": u.kind,
        "channel": u.channel,
        "share": rounded(u.share),
        "score": rounded(u.score),
        **{name: rounded(value) for name, value in u.numbers.items()},
    }


def rounded(value: float) -> float:
    """Seven digits: what two runs of the same bytes agree on whatever the order of a sum."""
    return float(f"{value:.7g}") if math.isfinite(value) else 0.0
