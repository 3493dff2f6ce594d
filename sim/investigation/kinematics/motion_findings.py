"""What a transmission error has: lost motion, errors over the angle, and what they explain of unseen rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.description.axis import Axis
from sim.investigation.assessment.calibration import WEIGHTS
from sim.investigation.data.excitation import ERROR_ORDERS
from sim.investigation.estimation.problem import MISTAKEN
from sim.investigation.hypotheses.hypothesis import AS_NEW_FACTOR
from sim.investigation.hypotheses.identifiability import ALONE
from sim.investigation.kinematics.transmission_error import (
    BLOCKS,
    LAG,
    OFFSET,
    REVERSAL,
    SLOPE,
    Amplitude,
    TransmissionError,
    cosine,
    is_larger_than,
    sine,
)
from sim.investigation.model.nominal import STATED_SPREAD
from sim.investigation.report.formatting import angle, number
from sim.investigation.results import REPORTED, Estimate, Finding, Gain
from sim.investigation.search.criterion import LEAST_EFFECT
from sim.investigation.unexplained import Unexplained
from sim.mechanisms import Backlash, Eccentricity, EncoderError, Hysteresis, MeshError, TimeDelay
from sim.mechanisms.catalogue import mechanism_of
from sim.mechanisms.locations import meshes
from sim.mechanisms.mechanism import Need

SPREAD = math.sqrt(2.0) * STATED_SPREAD  # of friction over stiffness


@dataclass(frozen=True)
class AsNew:
    """Felt at the load [rad]: gap, what the described friction winds up in both directions together, errors.

    `found`: a gap that the description has as a mechanism, found before.
    """

    gap: float
    found: float
    windup: float
    error: float

    @staticmethod
    def of(axis: Axis, speed_rad_s: float) -> AsNew:
        """From the description alone; friction T at the load winds a spring c up by T / c, either way.

        `speed_rad_s`: the one of the load at which viscous friction is the same as dry; 0 where it is told from it.
        """
        springs = zip(axis.stages, axis.stiffness(), strict=False)
        compliance = sum(1.0 / c / axis.ratio_from(stage.name) ** 2 for stage, c in springs if c)
        gaps = [mechanism_of(known) for known in axis.mechanisms if known.name == Backlash.name]
        return AsNew(
            sum(stage.backlash_rad / axis.ratio_from(stage.name) for stage in axis.stages),
            sum(known["gap_rad"] / axis.ratio_from(known.location or "load") for known in gaps),
            2.0
            * (axis.load.coulomb_friction_n_m + axis.load.viscous_friction_n_m_s_per_rad * speed_rad_s)
            * compliance,
            max([axis.load_encoder.error_rad, *(stage.transmission_error_rad for stage in axis.stages)]),
        )

    def has_less(self, lost: Amplitude) -> bool:
        """Whether lost motion is more than as new, by its best value also than what friction winds up besides."""
        most = max(self.gap, self.found) + self.windup * (1.0 + LEAST_EFFECT * SPREAD)
        return is_larger_than(lost, self._limit, 1) and lost.value > most

    def surely_has_less(self, lost: Amplitude) -> bool:
        """The same, were friction and stiffness off by as much as makes a number of a data sheet wrong."""
        return is_larger_than(lost, self._limit + self.most_windup, 1)

    @property
    def most_windup(self) -> float:
        """Were friction and stiffness off by as much as makes a number of a data sheet wrong."""
        return self.windup * (1.0 + MISTAKEN * SPREAD)

    @property
    def least_windup(self) -> float:
        """The same, the other way round."""
        return self.windup * (1.0 - MISTAKEN * SPREAD)

    @property
    def _limit(self) -> float:
        return max(AS_NEW_FACTOR * self.gap, self.found)

    def is_exceeded(self, size: Amplitude) -> bool:
        """Whether an error that repeats with the angle is clearly more than as new."""
        return is_larger_than(size, AS_NEW_FACTOR * self.error, 2)


def place_of_gap(axis: Axis) -> str | None:
    """The mesh at the output, where play is meant that no one has placed."""
    return next(iter(meshes(axis)), None)


def like_a_gap(axis: Axis, lacks: frozenset[Need] = frozenset()) -> tuple[str, ...]:
    """What two encoders alone do not tell from play, in a motion that lacks something."""
    late = (TimeDelay.name,) if Need.SEVERAL_SPEEDS in lacks else ()
    return (*late, Hysteresis.name) if meshes(axis) else late


Array = NDArray[np.float64]

LEFT_OPEN = {
    Need.BOTH_DIRECTIONS: "lost motion was not examined",
    Need.SEVERAL_SPEEDS: "lost motion and a channel that is late are the same",
}


def findings_in_motion(axis: Axis, seen: TransmissionError) -> tuple[Finding, ...]:
    """All that is clearly more than as new, and without which unseen rows are predicted worse."""
    new = _as_new(axis, seen)
    lost = _lost_motion(axis, seen, new)
    found = [*([lost] if lost else []), *_over_angle(axis, seen, new)]
    left = _rms(_left(seen, found))
    return tuple(f for f in found if _rms(_left(seen, [other for other in found if other is not f])) > left)


def _as_new(axis: Axis, seen: TransmissionError) -> AsNew:
    one_speed = Need.SEVERAL_SPEEDS in seen.lacks
    return AsNew.of(axis, float(np.median(np.abs(seen.speed))) if one_speed else 0.0)


def _lost_motion(axis: Axis, seen: TransmissionError, new: AsNew) -> Finding | None:
    size = seen.lost_motion()
    if size is None or not new.has_less(size):
        return None
    one_speed = Need.SEVERAL_SPEEDS in seen.lacks
    more = new.surely_has_less(size)
    sure = WEIGHTS.cap if more and not one_speed else ALONE
    said = [
        f"At the same angle the load is {number(size.value, size.error)} rad ({angle(size.value, size.error)}) further "
        "behind the motor in one direction of motion than in the other. That is lost motion: backlash, or friction "
        "that winds the gear up; only the torque can separate the two."
    ]
    if new.windup > 0.0:
        kept = "were taken off" if more else "may be all of it"
        said.append(f"The described friction and stiffness wind up {number(new.windup)} rad, which {kept}.")
    if one_speed:
        said.append("At one speed a channel that is late looks the same.")
    low = max(size.low - new.most_windup, 0.0)
    if more:
        gap = Estimate("gap_rad", size.value - new.windup, "rad", low, size.high - new.least_windup)
    else:
        gap = Estimate("gap_rad", size.value, "rad", low, size.high)
    return Finding(
        Backlash.name, place_of_gap(axis), sure, (gap,), like_a_gap(axis, seen.lacks), " ".join(said),
        lacks=(Need.SEVERAL_SPEEDS.value,) if one_speed else (),
    )  # fmt: skip


def _over_angle(axis: Axis, seen: TransmissionError, new: AsNew) -> list[Finding]:
    """Errors once per turn, and once per tooth where the teeth are known."""
    if not seen.whole:
        return []
    last = axis.stages[-1].name if axis.stages else None
    once = (Eccentricity.name, last, (EncoderError.name,)) if last else (EncoderError.name, "load", ())
    names: list[tuple[int, str, str | None, tuple[str, ...]]] = [(1, *once)]
    names += [(order, MeshError.name, last, ()) for order in seen.orders if order > ERROR_ORDERS]
    return [
        _error(seen, order, mechanism, place, alike)
        for order, mechanism, place, alike in names
        if new.is_exceeded(seen.amplitude(order))
    ]


def _error(seen: TransmissionError, order: int, mechanism: str, place: str | None, alike: tuple[str, ...]) -> Finding:
    size, whole = seen.amplitude(order), seen.repeatable()
    # runout holds the load back where an encoder that reads too much seems to bring it forward
    phase = seen.phase(order) + (math.pi if mechanism == EncoderError.name else 0.0)
    phase = math.atan2(math.sin(phase), math.cos(phase))
    reach = (size.high - size.low) / 2.0 / size.value
    often = "once per turn" if order == 1 else f"once per tooth ({order} per turn)"
    text = (
        f"Motor and load differ by {number(size.value, size.error)} rad ({angle(size.value, size.error)}) {often} of "
        f"the load. All that repeats with its angle comes to {number(whole)} rad ({angle(whole)}) from peak to peak."
    )
    sizes = (
        Estimate("amplitude_rad", size.value, "rad", size.low, size.high),
        Estimate("phase_rad", phase, "rad", phase - reach, phase + reach),
    )
    return Finding(mechanism, place, WEIGHTS.cap, sizes, alike, text)


def columns_of(seen: TransmissionError, findings: Sequence[Finding]) -> tuple[str, ...]:
    """Regressors of a model with these findings, beside what has no name: offset, ratio, a channel that is late.

    Within less than a turn neither has what repeats with the angle.
    """
    orders = [] if seen.whole else list(seen.orders)
    for finding in findings:
        if finding.mechanism != Backlash.name:
            orders.append(seen.orders[-1] if finding.mechanism == MeshError.name else 1)
    played = any(finding.mechanism == Backlash.name for finding in findings)
    names = [OFFSET, LAG, SLOPE, *([REVERSAL] if played else [])]
    names += [name for order in orders for name in (cosine(order), sine(order))]
    return tuple(name for name in names if name in seen.columns)


def gain_in_motion(seen: TransmissionError, findings: Sequence[Finding]) -> Gain:
    """What is left of unseen rows without and with what was said."""
    before, after = _left(seen, ()), _left(seen, [f for f in findings if f.probability >= REPORTED])
    size = before.size // BLOCKS
    drop = (before**2 - after**2)[: BLOCKS * size].reshape(BLOCKS, size).mean(axis=1)
    significant = bool(drop.mean() > 2.0 * drop.std(ddof=1) / math.sqrt(BLOCKS))
    return Gain("load_position_rad", "rad", _rms(before), _rms(after), significant, 0.0)


def nameless_in_motion(axis: Axis, seen: TransmissionError, findings: Sequence[Finding]) -> Unexplained | None:
    """The largest of what comes back several times per turn, for which no mechanism here has a name."""
    new = _as_new(axis, seen)
    sizes = {order: seen.amplitude(order) for order in seen.orders if seen.whole and 1 < order <= ERROR_ORDERS}
    beyond = {order: size for order, size in sizes.items() if new.is_exceeded(size)}
    if not beyond:
        return None
    order = max(beyond, key=lambda one: beyond[one].value)
    size = beyond[order]
    share = 0.5 * size.value**2 / float(np.mean(_left(seen, findings) ** 2))
    return Unexplained(
        "transmission error", "load_position_rad", min(share, 1.0), size.value / size.error,
        {"order": float(order), "amplitude_rad": size.value},
    )  # fmt: skip


def remarks_on_motion(axis: Axis, seen: TransmissionError) -> tuple[str, ...]:
    """What the motion does not have, and what was taken away before anything was looked for."""
    said = [f"The record lacks {need.value}: {LEFT_OPEN[need]}." for need in LEFT_OPEN if need in seen.lacks]
    if not seen.whole:
        said.append("The record lacks a whole turn of the load: errors once per turn were not examined.")
    if (late := _clear(seen, LAG)) is not None:
        said.append(
            f"The load is behind by {number(1e3 * late)} ms whatever the direction: its channel is late, or friction "
            "that grows with the speed winds the gear up; it was taken away first."
        )
    if (slip := _clear(seen, SLOPE)) is not None:
        said.append(
            f"The two encoders fit a ratio of {axis.ratio / (1.0 - slip):.6g} and not of {axis.ratio:.6g}; the "
            "difference was taken away first."
        )
    return tuple(said)


def _clear(seen: TransmissionError, name: str) -> float | None:
    """A coefficient that noise alone does not make."""
    if name not in seen.columns:
        return None
    size = seen.fit.amplitude((name,))
    return size.value if is_larger_than(size, 0.0, 1) or is_larger_than(-size, 0.0, 1) else None


def _left(seen: TransmissionError, findings: Sequence[Finding]) -> Array:
    """What a model with these findings leaves of rows that it was not fitted to [rad]."""
    return seen.fitted(columns_of(seen, findings)).held_out


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
