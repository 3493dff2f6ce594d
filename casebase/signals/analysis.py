"""Analysis: what several feature families need of one recording, each computed once, when asked for."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from casebase.signals.condition import OperatingCondition
from casebase.signals.recording import Recording

ANALYSIS_RATE_HZ = 8000.0
"""Sample rate that every recording is brought to [Hz]; the paper's."""


@dataclass(frozen=True, eq=False)
class Analysis:
    """A recording at the analysis rate, with its condition."""

    recording: Recording
    condition: OperatingCondition

    @cached_property
    def samples(self) -> NDArray[np.float32]:
        """Samples at the analysis rate without their mean, shape (n,) [unit]."""
        samples = self.recording.resampled(ANALYSIS_RATE_HZ).samples
        centred: NDArray[np.float32] = samples - np.float32(samples.mean(dtype=np.float64))
        return centred
