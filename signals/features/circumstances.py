"""Circumstances: how much a recording lets hear, whatever the gear is like; for how sure one may be of an answer.

None of these enters a distance: they say how well a fault would be heard, not whether there is one.
"""

from collections.abc import Sequence

from signals.analysis import Analysis
from signals.band import Band
from signals.features.family import FeatureFamily
from signals.features.vector import FeatureDefinition
from signals.recording_quality.circumstances import louder_after_start_db, low_band_level_db, standstill_db

MOST_CYCLES = 100.0


def _definition(name: str, unit: str, physics: str) -> FeatureDefinition:
    return FeatureDefinition(name, unit, physics, "definition; signals.recording_quality.circumstances", compared=False)


class Circumstances(FeatureFamily):
    """How many cycles are left, how much of the sound is the machine's, and what the recorder did to it."""

    of_the_gear = False
    definitions = (
        _definition("cycles_left", "1", "Cycles of the motion that are left when what is not the machine is left out."),
        _definition("share_left_out", "1", "Share of the piece of motion that is left out as none of the machine."),
        _definition(
            "standstill_fall_above_200_hz",
            "dB",
            "How much quieter it is at standstill than on the way; what is left at standstill is noise of the "
            "surroundings, under which a fault may hide.",
        ),
        _definition(
            "noise_on_the_way_12_200_hz",
            "dB",
            "Level of the band on the way against what the machine itself sounds like above 200 Hz: under how much low "
            "noise an impact may hide, whatever the gain.",
        ),
        _definition(
            "unrepeated_share_12_200_hz",
            "1",
            "Share of the time in which the band is more than twice or less than half as loud as in other cycles.",
        ),
        _definition("unrepeated_share_above_200_hz", "1", "The same above 200 Hz, in the worse of two bands."),
        _definition(
            "louder_after_start",
            "dB",
            "How much louder the sound is just after a start than before braking: a recorder that turns up its gain "
            "at standstill does that.",
        ),
        _definition(
            "low_band_level",
            "dB",
            "Level per hertz of 30 to 120 Hz against 250 to 500 Hz: what telephones and voice recorders filter away.",
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return all of them; 0 where there is no motion, never NaN."""
        period_s = analysis.motion.period_s
        left_out = sum(span.duration_s for span in analysis.left_out)
        kept_s = max(0.0, analysis.duration_s - left_out)
        share = {} if analysis.unrepeated is None else analysis.unrepeated.share
        return [
            min(kept_s / period_s, MOST_CYCLES) if period_s else 0.0,
            min(1.0, left_out / analysis.duration_s),
            *standstill_db(analysis),
            share.get(Band.LOW, 0.0),
            max(share.get(Band.MIDDLE, 0.0), share.get(Band.HIGH, 0.0)),
            louder_after_start_db(analysis),
            low_band_level_db(analysis),
        ]
