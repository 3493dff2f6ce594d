"""The crest factor of one's own recording, drawn as in figures 8 and 9 of the paper."""

import numpy as np
import pytest

from app.report.charts import crest_trace
from benchmarks.harness.sounds import RATE_HZ, hum
from signals import crest
from signals.condition import UNKNOWN
from signals.recording import Recording
from signals.recording_quality.disturbances import survey


def test_mean_largest_and_reversals_stand_beside_the_trace() -> None:
    samples = hum(8.0, 4, impacts=True)
    surveyed, found = survey(Recording(samples, RATE_HZ), UNKNOWN), crest.crest_trace(samples, RATE_HZ)
    chart = crest_trace(surveyed)
    trace, mean = chart.series
    assert (trace.x.tolist(), trace.y.tolist()) == (found.middle_s.tolist(), found.values.tolist())
    assert mean.y == pytest.approx(np.full(found.values.size, found.mean))
    assert chart.events == (found.middle_s[found.values.argmax()],)
    at = [marker.x - surveyed.start_s for marker in chart.markers]
    assert at == pytest.approx(surveyed.analysis.motion.reversal_times_s)
    assert len(at) > 1
