"""The contract of every mechanism, over the whole catalogue; and that each leaves the signature that it claims."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.telemetry import Telemetry
from sim.chain.integrate import run_chain
from sim.chain.model import Chain, ChainResult, Servo
from sim.description.axis import Axis
from sim.description.axis_document import read_axis, write_axis
from sim.errors import ParameterError
from sim.mechanisms import MECHANISMS
from sim.mechanisms.catalogue import mechanism_of, with_mechanism
from sim.mechanisms.mechanism import Law, Measurement, Mechanics, Mechanism
from tests.sim.axes import axis, chain_of_axis

Array = NDArray[np.float64]
CONTRACT = [
    "backlash", "tooth_damage", "eccentricity", "mesh_error", "kinematic_error", "coulomb_friction", "viscous_friction",
    "stribeck_friction", "friction_asymmetry", "load_dependent_loss", "friction_drift", "gravity_imbalance",
    "torque_ripple", "stiffness_hardening", "hysteresis", "bearing_defect", "structural_resonance", "torque_offset",
    "torque_gain", "encoder_error", "time_delay", "electrical_hum", "clipping", "lost_samples",
]  # fmt: skip
CONTRACT_PARAMETERS = {
    "backlash": "gap_rad",
    "tooth_damage": "angle_rad depth_rad flank",
    "eccentricity": "amplitude_rad",
    "mesh_error": "amplitude_rad",
    "kinematic_error": "amplitude_rad order",
    "gravity_imbalance": "torque_n_m phase_rad",
    "coulomb_friction": "torque_n_m",
    "viscous_friction": "coefficient_n_m_s_per_rad",
    "stribeck_friction": "torque_n_m speed_rad_s",
    "torque_ripple": "torque_n_m order",
    "friction_drift": "rate_per_s",
    "load_dependent_loss": "fraction",
    "stiffness_hardening": "cubic_per_rad2",
    "hysteresis": "torque_n_m",
    "bearing_defect": "order",
    "torque_offset": "torque_n_m",
    "electrical_hum": "frequency_hz",
    "torque_gain": "share start_s end_s",
}
RATE = 2000.0
PLAIN = axis()
ALL = pytest.mark.parametrize("kind", MECHANISMS.values(), ids=MECHANISMS.keys())
MECHANICS = [kind for kind in MECHANISMS.values() if issubclass(kind, Mechanics)]
MEASUREMENTS = [kind for kind in MECHANISMS.values() if issubclass(kind, Measurement)]


def test_the_catalogue_has_the_names_of_the_contract() -> None:
    assert list(MECHANISMS) == CONTRACT
    for name, parameters in CONTRACT_PARAMETERS.items():
        assert set(parameters.split()) <= {parameter.name for parameter in MECHANISMS[name].parameters}


@ALL
def test_each_says_what_it_is(kind: type[Mechanism]) -> None:
    assert re.search(r"Equations: .*Source: ", kind.__doc__ or "", re.DOTALL)
    assert kind.size in {parameter.name for parameter in kind.parameters}
    for parameter in kind.parameters:
        assert parameter.low < parameter.high
        assert parameter.low <= parameter.default <= parameter.high
        assert parameter.unit
    assert kind.locations(PLAIN)
    order = kind.signature.order
    assert not isinstance(order, str) or order == "mesh" or order in {each.name for each in kind.parameters}


@ALL
def test_unknown_and_impossible_numbers_are_refused_by_name(kind: type[Mechanism]) -> None:
    first = next(each for each in kind.parameters if not each.periodic)
    with pytest.raises(ParameterError, match=f"{kind.name}.{first.name}: must be"):
        kind(None, {first.name: first.high * 1.01 + 1e-9})
    with pytest.raises(ParameterError, match="must be a finite number"):
        kind(None, {first.name: float("nan")})
    with pytest.raises(ParameterError, match=f"{kind.name}.sise: unknown parameter"):
        kind(None, {"sise": 1.0})


@ALL
def test_a_place_where_it_cannot_be_is_refused(kind: type[Mechanism]) -> None:
    with pytest.raises(ParameterError, match=rf"{kind.name}.location: must be one of .*, got 'gripper'"):
        kind("gripper").placed(PLAIN)


@ALL
def test_each_survives_the_axis_description(kind: type[Mechanism]) -> None:
    described = with_mechanism(PLAIN, kind())
    again = read_axis(tomllib.loads(write_axis(described)))
    assert again == described
    assert mechanism_of(again.mechanisms[0]) == mechanism_of(described.mechanisms[0])


@pytest.mark.parametrize("kind", MECHANICS, ids=lambda kind: kind.name)
def test_of_size_null_it_changes_nothing(kind: type[Mechanics]) -> None:
    for place in kind.locations(PLAIN):
        nothing = with_mechanism(PLAIN, kind(place, {kind.size: 0.0}))
        assert chain_of_axis(nothing) == chain_of_axis(PLAIN)


@pytest.mark.parametrize("kind", MECHANICS, ids=lambda kind: kind.name)
def test_of_its_usual_size_it_changes_what_is_simulated(kind: type[Mechanics]) -> None:
    """A part that shafts in series have no place for, such as a second drive, would leave no trace."""
    for place in kind.locations(PLAIN):
        assert chain_of_axis(with_mechanism(PLAIN, kind(place))) != chain_of_axis(PLAIN), f"{place}: no trace of it"


@pytest.mark.parametrize("kind", MEASUREMENTS, ids=lambda kind: kind.name)
def test_a_measurement_is_distorted_by_its_size_alone(kind: type[Measurement]) -> None:
    t = np.arange(4000) / RATE
    one, half = np.sin(2 * np.pi * t), np.sin(np.pi * t)
    channels = {"motor_torque_nm": 3.0 * one, "motor_position_rad": 50.0 * half, "load_position_rad": 0.5 * half}
    telemetry = Telemetry(t, channels)
    sound = np.sin(np.arange(8000) * 0.3).astype(np.float32)
    nothing = kind(None, {kind.size: 0.0})
    same = nothing.distort(telemetry, PLAIN)
    assert same.rows == telemetry.rows
    for name, values in telemetry.channels.items():
        np.testing.assert_array_equal(same[name], values)
    np.testing.assert_array_equal(nothing.distort_sound(sound, 8000.0), sound)
    changed = kind().distort(telemetry, PLAIN, 3)
    again = kind().distort(telemetry, PLAIN, 3)
    assert changed.rows < telemetry.rows or any(
        np.abs(changed[name] - telemetry[name]).max() > 1e-4 for name in telemetry.channels
    )
    np.testing.assert_array_equal(changed.time_s, again.time_s)


# --- signatures: the residual against the plain axis, while a stiff servo moves the motor


def _steady(speed: float, seconds: float) -> Array:
    """Angle, speed and acceleration of a motor that turns steadily, shape (3, n)."""
    t = np.arange(round(seconds * RATE)) / RATE
    return np.stack([speed * t, np.full(t.size, speed), np.zeros(t.size)])


def _swing(amplitude: float, hertz: float, seconds: float = 4.0) -> tuple[Array, Array]:
    """Times and a motor that swings, from the middle backwards; as `_steady`."""
    t, omega = np.arange(round(seconds * RATE)) / RATE, 2 * np.pi * hertz
    return t, amplitude * np.stack([-np.cos(omega * t), omega * np.sin(omega * t), omega**2 * np.cos(omega * t)])


def _moved(chain: Chain, motion: Array) -> ChainResult:
    inertia = chain.shafts[0].inertia_kg_m2
    reference = motion * np.array([[1.0], [1.0], [inertia]])
    return run_chain(chain, Servo(reference, 100.0, 600.0 * inertia, 0.01, 1e9, 1e9), RATE, motion.shape[1])


def _residual(mechanism: Mechanism, motion: Array, base: Axis = PLAIN) -> tuple[Array, Array, Array]:
    """Change of the motor torque and of the load's lag by a mechanism; and the angles of the run, (n, shafts)."""
    one, other = (_moved(chain_of_axis(axis), motion) for axis in (with_mechanism(base, mechanism), base))
    last = len(base.stages)
    lag = [run.angle_rad[:, last] - run.angle_rad[:, 0] / base.ratio for run in (one, other)]
    return one.motor_torque_n_m - other.motor_torque_n_m, lag[0] - lag[1], other.angle_rad


def _order_of(residual: Array, angle: Array) -> float:
    """Order with the largest amplitude over the angle of a shaft, after the first tenth of the run."""
    first = residual.size // 10
    even = np.linspace(angle[first], angle[-1], residual.size)
    values = np.interp(even, angle[first:], residual[first:])
    values = (values - values.mean()) * np.hanning(values.size)
    spectrum = np.abs(np.fft.rfft(values, 4 * values.size))
    orders = np.fft.rfftfreq(4 * values.size, (even[1] - even[0]) / (2 * np.pi))
    return float(orders[np.argmax(spectrum)])


ANGULAR: list[tuple[str, str, dict[str, float], int, float]] = [
    ("eccentricity", "output", {}, 2, 1.0),
    ("eccentricity", "transfer", {}, 1, 1.0),
    ("eccentricity", "motor", {}, 0, 1.0),
    ("mesh_error", "output", {}, 2, 121.0),
    ("mesh_error", "transfer", {}, 1, 90.0),
    ("kinematic_error", "output", {}, 1, 2.0),
    ("kinematic_error", "transfer", {"order": 3.0}, 0, 3.0),
    ("gravity_imbalance", "load", {}, 2, 1.0),
    ("torque_ripple", "motor", {"order": 4.0}, 0, 4.0),
    ("bearing_defect", "motor", {"order": 3.3}, 0, 3.3),
    ("bearing_defect", "transfer", {"order": 5.4}, 1, 5.4),
]


@pytest.mark.parametrize(("name", "place", "values", "shaft", "order"), ANGULAR)
def test_an_order_is_where_the_signature_says(
    name: str, place: str, values: dict[str, float], shaft: int, order: float
) -> None:
    slow = 150.0 if shaft == 2 and order == 1 else 60.0
    torque, _, angles = _residual(MECHANISMS[name](place, values), _steady(slow, 20.0))
    harmonic = _order_of(torque, angles[:, shaft]) / order
    assert harmonic == pytest.approx(round(harmonic), abs=0.05)
    assert 1 <= round(harmonic) <= 5
    claimed = MECHANISMS[name].signature.order
    assert claimed == order or isinstance(claimed, str)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("coulomb_friction", "motor"),
        ("coulomb_friction", "load"),
        ("viscous_friction", "motor"),
        ("viscous_friction", "load"),
        ("stribeck_friction", "motor"),
        ("friction_asymmetry", "motor"),
        ("load_dependent_loss", "output"),
        ("load_dependent_loss", "transfer"),
        ("friction_drift", None),
    ],
)
def test_friction_turns_with_the_direction_as_claimed(name: str, place: str | None) -> None:
    kind = MECHANISMS[name]
    forward, backward = (float(_residual(kind(place), _steady(way * 8.0, 2.0))[0][2000:].mean()) for way in (1.0, -1.0))
    assert abs(forward) > 1e-4
    if kind.signature.direction == "opposite":
        assert backward == pytest.approx(-forward, rel=1e-3)
    else:
        assert kind.signature.direction == "one"
        assert backward == pytest.approx(forward, rel=1e-3)


def test_what_grows_with_speed_load_or_time_does() -> None:
    def mean(name: str, speed: float, base: Axis = PLAIN, part: slice = slice(4000, None)) -> float:
        return abs(float(_residual(MECHANISMS[name](), _steady(speed, 4.0), base)[0][part].mean()))

    heavy = replace(PLAIN, load=replace(PLAIN.load, coulomb_friction_n_m=70.0))
    assert mean("viscous_friction", 80.0) == pytest.approx(2 * mean("viscous_friction", 40.0), rel=0.02)
    assert mean("coulomb_friction", 80.0) == pytest.approx(mean("coulomb_friction", 40.0), rel=0.02)
    assert mean("load_dependent_loss", 20.0, heavy) > 4 * mean("load_dependent_loss", 20.0)
    late, early = (mean("friction_drift", 40.0, part=part) for part in (slice(7000, 8000), slice(3000, 4000)))
    assert late / early == pytest.approx(7500 / 3500, rel=0.02)
    assert mean("stribeck_friction", 40.0) < 0.01 * mean("stribeck_friction", 1.0)


def test_hardening_stiffens_with_the_twist() -> None:
    """Twist under a steady torque F solves c x (1 + k x^2) = F."""
    base = replace(
        PLAIN,
        load=replace(PLAIN.load, coulomb_friction_n_m=800.0),
        stages=tuple(replace(stage, backlash_rad=0.0) for stage in PLAIN.stages),
    )
    hard = MECHANISMS["stiffness_hardening"]("output", {"cubic_per_rad2": 1e4})
    _, lag, _ = _residual(hard, _steady(20.0, 4.0), base)
    torque = 800.0 + 5.0 * 20.0 / 99.0
    x = torque / 130e3
    stiff = next(root.real for root in np.roots([130e3 * 1e4, 0, 130e3, -torque]) if abs(root.imag) < 1e-12)
    assert lag[-2000:].mean() == pytest.approx(x - stiff, rel=0.01)


def test_hysteresis_keeps_its_torque_after_the_load_is_gone() -> None:
    """Twist forward and back to the same torque differs by the loop: lost motion without a gap."""
    kind = MECHANISMS["hysteresis"]
    torque, _, _ = _residual(kind("output", {"torque_n_m": 30.0}), _swing(40.0, 1.0)[1])
    assert 0.1 < np.sqrt(np.mean(torque[2000:] ** 2)) < 3 * 30.0 / 99.0
    assert kind.signature.domain == "twist"


def test_a_resonance_stays_at_its_frequency_whatever_the_speed() -> None:
    peaks = []
    for speed in (1.0, 2.5):
        t, swing = _swing(20.0, speed, 8.0)
        kind = MECHANISMS["structural_resonance"]
        structure = kind("load", {"frequency_hz": 37.0, "share": 0.02, "damping_ratio": 0.003})
        chain = chain_of_axis(with_mechanism(PLAIN, structure))
        run = _moved(chain, swing)
        relative = run.angle_rad[:, 3] - run.angle_rad[:, 2]
        spectrum = np.abs(np.fft.rfft(relative * np.hanning(t.size)))
        frequency = np.fft.rfftfreq(t.size, 1 / RATE)
        above = frequency > 30.0
        peaks.append(float(frequency[above][np.argmax(spectrum[above])]))
    np.testing.assert_allclose(peaks, 37.0 * np.sqrt(1 / (1 - 0.02)), rtol=0.02)


@pytest.mark.parametrize("law", Law)
def test_a_law_is_that_of_several_mechanisms_and_leaves_less_than_it_gains(law: Law) -> None:
    assert sum(law in kind.traits.laws for kind in MECHANISMS.values()) > 1
    assert 0.0 < law.share < 1.0
