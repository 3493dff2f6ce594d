"""What a microphone near the axis hears, and what its drive logs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, iirpeak, lfilter, sosfilt, sosfiltfilt

from benchmarks.operating_points import gearboxes as axis
from benchmarks.operating_points.gearboxes import MOTION_RATE, RATIO, Array, Fault, Motion, OperatingPoint, Specimen

# how loud things are beside rolling, chosen by the bands and crest factors of measured axes
MESH, CLICK, NOTCH, BEARING, RUB, RUMBLE, HISS = (0.25, 0.15), (4.0, 0.4), 6.0, 5.0, 1.2, 0.22, 0.06
WINDOW = 0.02  # s after an event in which the fault is held against the rest
TELEMETRY_RATE = 1000.0  # Hz


@dataclass(frozen=True)
class Telemetry:
    """What the drive logs, arrays (m,): seconds, load angle [rad], motor speed [rad/s], current [A]; and N m per A."""

    time_s: Array
    load_angle_rad: Array
    motor_speed_rad_s: Array
    motor_current_a: Array
    torque_per_ampere: float


@dataclass(frozen=True)
class Recording:
    """A sound, and what is true of it.

    Attributes
    ----------
    samples, rate : array (n,), within -1 and 1; Hz
    telemetry : Telemetry or None
    label : what is built in, whether it can be heard or not
    audible : rms of what the fault adds over rms of the sound without it, in the 20 ms after each of its events, in
        12 to 200 Hz (play, notch) or 400 to 3600 Hz (bearing, rub); 0 without events
    met : how often the damaged tooth was met under load of its damaged flank, or the rubbing place passed
    """

    samples: Array
    rate: int
    telemetry: Telemetry | None
    label: axis.Label
    audible: float
    met: int


def _pulses(n: int, rate: float, times: Array, sizes: Array, widths: Array) -> Array:
    """Add half sines of ``sizes`` and ``widths`` [s] that begin at ``times`` [s]: array (n,)."""
    out = np.zeros(n)
    index = np.floor(times * rate).astype(np.int64)[:, None] + np.arange(int(np.max(widths, initial=0) * rate) + 2)
    share = (index / rate - times[:, None]) / widths[:, None]
    inside = (share >= 0) & (share <= 1) & (index < n)
    np.add.at(out, index[inside], (sizes[:, None] * np.sin(np.pi * share))[inside])
    return out


def _meetings(motion: Motion, turns: float, angle_rad: float) -> tuple[Array, NDArray[np.int64]]:
    """Find when a place on a gear passes the mesh: times [s] and indices at MOTION_RATE."""
    place = (motion.angle * turns - angle_rad) / (2 * np.pi)
    index = np.flatnonzero(np.diff(np.floor(place)))
    edge = np.maximum(np.floor(place[index]), np.floor(place[index + 1]))
    return (index + (edge - place[index]) / (place[index + 1] - place[index])) / MOTION_RATE, index


def _clicks(
    specimen: Specimen, motion: Motion, mesh: int, more: float, payload: float, n: int, rate: int, seed: int
) -> tuple[Array, Array]:
    """Let flanks with ``more`` play [rad] than as new hit each other: force (n,), times [s] of all but the faint."""
    inertia = axis.free_inertia(payload)[mesh]
    times, speeds, flank = axis.impacts(motion.torque[mesh], inertia, specimen.backlash_rad[mesh] + more)
    # uneven by the tenth of a second at which it happens, so that play changes no other impact
    uneven = np.random.default_rng([seed, 5, mesh]).lognormal(0, 0.15, int(len(motion.angle) / MOTION_RATE * 10) + 2)
    impulse = inertia * speeds / (0.1, 0.25)[mesh] * uneven[(times * 10).astype(np.int64)]  # N s, by the gear's radius
    size = CLICK[mesh] * specimen.impact[mesh] * flank * impulse
    force = _pulses(n, rate, times, size, np.full(len(times), specimen.contact_s[mesh]))
    return force, times[impulse > 0.2 * impulse.max(initial=0.0)]


def _fault_forces(
    specimen: Specimen, fault: Fault, motion: Motion, payload: float, n: int, rate: int, seed: int
) -> tuple[Array, Array, int]:
    """Compute what the fault adds to the forces: array (5, n), times of its events [s], and how often it was met."""
    rng, clock = np.random.default_rng([seed, 9]), np.arange(len(motion.angle)) / MOTION_RATE
    forces, met, times = np.zeros((5, n)), 0, np.zeros(0)
    pace = np.abs(motion.speed) / axis.REFERENCE_SPEED
    turns, mesh = axis.GEARS.get(fault.place, (1.0, 1))
    load = 0.5 + 0.5 * np.abs(motion.torque[mesh]) / axis.REFERENCE_TORQUE[mesh]
    way = np.cumsum(np.abs(np.gradient(motion.angle)))
    if fault.label == "play":
        forces[mesh], times = _clicks(specimen, motion, mesh, fault.size, payload, n, rate, seed)
        forces[mesh] -= _clicks(specimen, motion, mesh, 0.0, payload, n, rate, seed)[0]
    elif fault.label == "notch":  # the tooth gives way, then the next one is hit
        times, index = _meetings(motion, turns, fault.angle_rad)
        damaged = motion.torque[mesh][index] * fault.flank > 0
        times, index, met = times[damaged], index[damaged], int(damaged.sum())
        teeth = axis.AXIS["stages"][mesh]["driver_teeth" if fault.place.endswith("pinion") else "driven_teeth"]
        tooth_s = 2 * np.pi / teeth / np.maximum(np.abs(motion.speed[index]) * turns, 1e-3)
        lasting = np.clip(fault.width * tooth_s, 1e-3, 0.04)
        size = NOTCH * fault.size * fault.flank * load[index] * pace[index] ** 0.8 * rng.lognormal(0, 0.1, met)
        forces[mesh] = _pulses(n, rate, times + lasting, size, np.full(met, specimen.contact_s[mesh]))
        forces[mesh] -= 0.35 * _pulses(n, rate, times, size, lasting)
    elif fault.label == "bearing":  # balls pass by the angle, and slip a little
        passed = way * turns * fault.order / (2 * np.pi)
        balls = rng.uniform() + np.cumsum(1 + 0.012 * rng.normal(size=int(passed[-1] * 1.1) + 8))
        times = np.interp(balls[balls < passed[-1]], passed, clock)
        index = (times * MOTION_RATE).astype(np.int64)
        size = BEARING * fault.size * load[index] * pace[index] * rng.lognormal(0, 0.25, len(times))
        forces[3] = _pulses(n, rate, times, size, rng.uniform(4e-4, 8e-4, len(times)))
    elif fault.place == "turn":  # scrapes near one angle of the load, chattering by the angle
        away = np.abs((motion.angle - fault.angle_rad + np.pi) % (2 * np.pi) - np.pi)
        near = np.cos(np.pi / 2 * np.clip(away / fault.width, 0, 1)) ** 2 * np.minimum(pace, 2) ** 0.5
        chatter = 0.4 + (motion.angle / (0.02 + fault.width / 10)) % 1.0
        scrape = rng.normal(size=n) * np.sqrt(rate / 8000)
        forces[4] = 1.5 * RUB * fault.size * scrape * np.interp(np.arange(n) / rate, clock, near * chatter)
        met, every = len(_meetings(motion, 1.0, fault.angle_rad)[0]), round(WINDOW * MOTION_RATE)
        times = clock[::every][near[::every] > 0.5]
    elif fault.place == "stick_slip":  # slips from step to step while slow
        slow = np.clip(1 - pace / 0.4, 0, 1) * (pace > 1e-3)
        steps = np.cumsum(np.diff(way, prepend=way[:1]) * (slow > 0)) / fault.width
        slips = np.cumsum(rng.uniform(0.6, 1.4, int(steps[-1] * 1.7) + 8))
        times = np.interp(slips[slips < steps[-1]], steps, clock)
        size = 3 * RUB * fault.size * (0.3 + slow[(times * MOTION_RATE).astype(np.int64)])
        size, met = size * rng.lognormal(0, 0.3, len(times)), len(times)
        forces[4] = _pulses(n, rate, times, size, rng.uniform(6e-4, 2e-3, met))
    return forces, times, met


def _healthy_forces(specimen: Specimen, motion: Motion, payload: float, n: int, rate: int, seed: int) -> Array:
    """Compute the forces of a gearbox without fault: array (5, n)."""
    rng, clock, slow = np.random.default_rng([seed, 3]), np.arange(n) / rate, np.arange(len(motion.angle)) / MOTION_RATE
    angle, pace, *load = (
        np.interp(clock, slow, x)
        for x in (
            motion.angle,
            np.abs(motion.speed) / axis.REFERENCE_SPEED,
            *(np.abs(x) / reference for x, reference in zip(motion.torque, axis.REFERENCE_TORQUE, strict=True)),
        )
    )
    highest = (
        0.45 * rate / max(float(np.abs(motion.speed).max()) / (2 * np.pi), 1e-9)
    )  # order of the load the rate holds
    forces = np.zeros((5, n))
    for mesh, (turns, stage) in enumerate(((axis.SHAFT_RATIO, axis.TRANSFER), (1.0, axis.OUTPUT))):
        teeth, wheel = stage["driven_teeth"], angle * turns
        tooth, sound = np.exp(1j * teeth * wheel), np.zeros(n, complex)
        for k in range(8, 0, -1):
            sound = (sound + specimen.error[mesh][k - 1] * (k * teeth * turns < highest)) * tooth
        driver, driven = specimen.eccentricity[mesh]
        swell = 1 + (driver * np.exp(1j * wheel * teeth / stage["driver_teeth"]) + driven * np.exp(1j * wheel)).real
        pitch = specimen.pitch_error[mesh][np.floor(wheel * teeth / (2 * np.pi)).astype(np.int64) % teeth]
        error = swell * sound.real + pitch * (1 - tooth.real) / 2
        forces[mesh] = MESH[mesh] * error * (0.5 + 0.5 * load[mesh]) * pace
        forces[mesh] += _clicks(specimen, motion, mesh, 0.0, payload, n, rate, seed)[0]
    for order, size in ((1, 0.06), (2, 0.03), (12, 0.04), (24, 0.08)):  # unbalance, slots, the servo's current
        hum = np.cos(order * RATIO * angle + rng.uniform(0, 2 * np.pi)) * (order * RATIO < highest)
        forces[2] += size * rng.lognormal(0, 0.3) * (0.3 + load[0]) * hum
    rolling = specimen.rolling * (pace + 1e-4) ** specimen.rolling_power * (0.9 + 0.1 * load[0])
    forces[3] = rolling * rng.normal(size=n) * np.sqrt(rate / 8000)  # the same loudness per Hz at each rate
    return forces


def _microphone(specimen: Specimen, forces: Array, rate: int, seed: int) -> Array:
    """Let forces ring the housing and reach the microphone: array (n,). Linear, so that a fault's part can go alone."""
    rng, force = np.random.default_rng([seed, 4]), forces.sum(axis=0)
    out = RUMBLE * sosfilt(butter(1, 400, fs=rate, output="sos"), force) + HISS * force
    for hz, q, gain in zip(specimen.mode_hz, specimen.mode_q, specimen.mode_gain.T, strict=True):
        if hz < 0.45 * rate:
            out += lfilter(*iirpeak(hz, q, rate), gain @ forces)
    distance, longer, share = rng.uniform(0.15, 1.0), rng.uniform(0.3, 4.0), rng.uniform(0.2, 0.9)
    heard = np.zeros(len(out))
    for way, part in ((distance, 1.0), (distance + longer, share)):  # straight, and by one wall
        late = round(way / 343 * rate)
        heard[late:] += part / way * out[: len(out) - late]
    band = [rng.uniform(5, 14), min(0.46 * rate, rng.uniform(3500, 14000))]
    return np.asarray(sosfilt(butter(2, band, "band", fs=rate, output="sos"), heard))


def _room(rng: np.random.Generator, n: int, rate: int, level: float) -> Array:
    """Make the room without the axis: pink noise of rms ``level``, mains hum, and now and then a foreign knock."""
    spectrum = np.fft.rfft(rng.normal(size=n)) / np.sqrt(np.maximum(np.fft.rfftfreq(n, 1 / rate), 20))
    out, clock = np.fft.irfft(spectrum, n), np.arange(n) / rate
    out, mains = level * out / out.std(), float(rng.choice([50.0, 60.0])) * (1 + rng.normal(0, 2e-4))
    for k in (1, 2, 3):
        out += level * rng.uniform(0, 0.5) / k * np.cos(2 * np.pi * k * mains * clock + rng.uniform(0, 6))
    for _ in range(rng.poisson(n / rate / 50)):
        since = np.maximum(clock - rng.uniform(0, n / rate), 0)
        ring = np.sin(2 * np.pi * rng.uniform(90, 900) * since) * np.exp(-since / rng.uniform(0.005, 0.04))
        out += level * rng.lognormal(1.0, 0.6) * ring
    return np.asarray(out)


def _telemetry(specimen: Specimen, fault: Fault, motion: Motion, seed: int) -> Telemetry:
    """Log the motion as a drive does: noise, a current scale a little off, twist, and the motion lost in play."""
    rng, n, (inner, outer) = np.random.default_rng([seed, 6]), len(motion.angle), motion.torque
    gaps = specimen.backlash_rad.copy()
    if fault.label == "play":
        gaps[axis.GEARS[fault.place][1]] += fault.size
    shaft = inner / (axis.STIFFNESS[0] * specimen.stiffness) + gaps[0] / 2 * np.tanh(inner / 0.5)
    lag = shaft / axis.SHAFT_RATIO + outer / (axis.STIFFNESS[1] * specimen.stiffness) + gaps[1] / 2 * np.tanh(outer / 5)
    tooth = specimen.error[1][0] * np.exp(1j * axis.OUTPUT["driven_teeth"] * motion.angle)
    load = motion.angle - lag + axis.OUTPUT["transmission_error_rad"] * tooth.real + rng.normal(0, 2e-6, n)
    load += axis.AXIS["load_encoder"]["error_rad"] * np.cos(motion.angle + rng.uniform(0, 2 * np.pi))
    drag = axis.MOTOR["coulomb_friction_n_m"] * np.tanh(motion.speed / 0.02)
    drag += axis.MOTOR["viscous_friction_n_m_s_per_rad"] * RATIO * motion.speed
    torque = axis.MOTOR["inertia_kg_m2"] * RATIO * motion.acceleration + specimen.friction * drag
    torque += inner / axis.MOTOR_RATIO + 0.02 * np.cos(24 * RATIO * motion.angle)
    current = torque / 0.55 * (1 + rng.normal(0, 0.02)) + rng.normal(0, 0.05) + rng.normal(0, 0.12, n)
    clock, turning = np.arange(n) / MOTION_RATE, motion.speed * RATIO + rng.normal(0, 0.15, n)
    every = round(MOTION_RATE / TELEMETRY_RATE)
    return Telemetry(clock[::every], load[::every], turning[::every], current[::every], 0.55)


def record(
    specimen: Specimen,
    fault: Fault | None,
    point: OperatingPoint,
    seed: int,
    duration_s: float = 20.0,
    rate: int = 8000,
    with_telemetry: bool = False,
) -> Recording:
    """Record a gearbox at an operating point; the same arguments give the same samples.

    The seed draws the moment, the jitter, the noises and where the microphone stands; a fault changes none of these.
    """
    fault, n, payload = fault or Fault("normal"), round(duration_s * rate), point.payload_kg_m2
    motion = axis.move(specimen, point, np.random.default_rng([seed, 1]), duration_s)
    sound = _microphone(specimen, _healthy_forces(specimen, motion, payload, n, rate, seed), rate, seed)
    rng = np.random.default_rng([seed, 2])
    sound += _room(rng, n, rate, float(sound.std() * 10 ** (rng.uniform(-28, -18) / 20)))
    gain, audible = rng.lognormal(np.log(0.02), 0.7) / float(sound.std()), 0.0
    forces, times, met = _fault_forces(specimen, fault, motion, payload, n, rate, seed)
    added = _microphone(specimen, forces, rate, seed) if len(times) else np.zeros(n)
    if len(times):
        band = [12.0, 200.0] if fault.label in ("play", "notch") else [400.0, 3600.0]
        sieve = butter(4, band, "band", fs=rate, output="sos")
        index = (times[:, None] * rate).astype(np.int64) + np.arange(round(WINDOW * rate))
        near = np.unique(index[index < n])
        fault_rms, rms = (np.sqrt(np.mean(sosfiltfilt(sieve, x)[near] ** 2)) for x in (added, sound))
        audible = float(fault_rms / rms)
    telemetry = _telemetry(specimen, fault, motion, seed) if with_telemetry else None
    return Recording(np.clip((sound + added) * gain, -1, 1), rate, telemetry, fault.label, audible, met)
