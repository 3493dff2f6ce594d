"""What speaks for a diagnosis, as rows of a table that lead to the plots where it can be seen."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from app.report.formatting import percent, quantity, sentence
from signals.features import catalogue, feature_words

PLOTS = (
    ("crest_factor", "crest"),
    ("kurtosis_low", "crest"),
    ("rms", "level"),
    ("peak", "level"),
    ("band_level", "spectrum"),
    ("mesh", "spectrum"),
    ("modulation", "spectrogram"),
    ("spectral_kurtosis", "spectrogram"),
    ("motion_period", "waveform"),
    ("repetition", "waveform"),
    ("impulse_rate", "waveform"),
    ("strongest_impulse", "waveform"),
    ("", "fold"),
)
"""Where a quantity can be seen, by the beginning of its name; bumps and phases in the folded sound."""
TITLES = {
    "crest": "Crest factor",
    "level": "RMS and peak",
    "spectrum": "Spectrum",
    "spectrogram": "Spectrogram",
    "waveform": "Waveform",
    "fold": "Strokes laid over each other",
}


@dataclass(frozen=True)
class Compared:
    """A feature here and in the nearest cases; sides hold words and a number or a range, share is of the distance."""

    name: str
    physics: str
    here: Markup
    sides: tuple[tuple[str, Markup], ...]
    share: str
    plot: str | None
    title: str


@dataclass(frozen=True)
class Seen:
    """Something that was heard, in one sentence, when it was strongest [s], and the plot that shows it."""

    sentence: str
    at_s: float | None
    plot: str | None
    title: str


@dataclass(frozen=True)
class Evidence:
    """All that speaks for a diagnosis: what was compared and what was seen."""

    compared: tuple[Compared, ...]
    seen: tuple[Seen, ...]

    def __bool__(self) -> bool:
        return bool(self.compared or self.seen)


def evidence_of(document: Mapping[str, Any], drawn: Collection[str], strongest: Mapping[str, float]) -> Evidence:
    """Return the evidence of a diagnosis document.

    Args:
        drawn: names of the plots on the page; only these (and the spectrogram) are led to.
        strongest: when the strongest event of each kind happens [s].
    """
    items = document["evidence"]
    return Evidence(
        tuple(_compared(item, drawn) for item in items if item["kind"] == "feature"),
        tuple(
            Seen(
                sentence(item["statement"]),
                strongest.get(item["quantity"].removesuffix("_phase")),
                *_place(item["quantity"], drawn),
            )
            for item in items
            if item["kind"] != "feature"
        ),
    )


def _compared(item: Mapping[str, Any], drawn: Collection[str]) -> Compared:
    known = catalogue().get(item["quantity"])
    sides = tuple(_side(side, item["unit"]) for side in (item["same"], item["other"]) if side)
    return Compared(
        feature_words(item["quantity"]),
        known.physics if known else "",
        quantity(item["value"], item["unit"]),
        sides,
        percent(item["share"]),
        *_place(item["quantity"], drawn),
    )


def _side(side: Mapping[str, Any], unit: str) -> tuple[str, Markup]:
    if "low" in side:
        span = Markup("{} to {}").format(quantity(side["low"]), quantity(side["high"], unit))
        return f"usual of {side['label']}", span
    return f"nearest {side['label']} case, {side['origin']}", quantity(side["value"], unit)


def _place(quantity_name: str, drawn: Collection[str]) -> tuple[str | None, str]:
    plot = next(plot for beginning, plot in PLOTS if quantity_name.startswith(beginning))
    return (plot if plot in drawn or (plot == "spectrogram" and drawn) else None), TITLES[plot]
