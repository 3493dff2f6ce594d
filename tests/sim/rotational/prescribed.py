"""Drawn drive trains source - link - friction - inertia, and their equations written apart and integrated by scipy.

The body behind the link has one angle. Its motion is prescribed where the link is rigid or a closed clutch; else it
obeys J w' = T - F, with T the torque that the link gives and F the friction, and is stuck while F can equal T. With the
spring behind, the friction sits at the source and the body swings freely.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim.rotational.component import Component, Signal
from sim.rotational.components import (
    Accelerate,
    BearingFriction,
    Brake,
    Clutch,
    Constant,
    ConstantSpeed,
    Fixed,
    IdealGear,
    Inertia,
    LossyGear,
    Move,
    OneWayClutch,
    Position,
    Pulse,
    Ramp,
    Sine,
    Speed,
    SpringDamper,
    Step,
)
from sim.rotational.drive_train import DriveTrain

Array = NDArray[np.float64]
Law = Callable[[float], float]

SOURCES = (
    "constant speed",
    "exact speed: ramp",
    "exact speed: sine",
    "speed: step",
    "speed: pulse",
    "speed: sine",
    "exact position: sine",
    "exact position: constant",
    "position: ramp",
    "position: step",
    "position: sine",
    "accelerate: sine",
    "accelerate: pulse",
    "move: sine",
)
FRICTIONS = (
    "bearing",
    "bearing over speed",
    "brake",
    "brake by a signal",
    "clutch to ground",
    "lossy gear",
    "freewheel",
)
LINKS = ("rigid", "gear", "spring", "clutch", "spring behind")
DURATION_S = 1.0
SLACK = 1e-10
"""Torque [N m] by which a limit may be missed by rounding."""


class Contradiction(Exception):
    """What is prescribed cannot be: a freewheel is to turn backward."""


@dataclass(frozen=True)
class Driven:
    """A signal with its value, slope and bend written down here, and where it is not smooth."""

    signal: Signal
    value: Law
    slope: Law
    bend: Law
    breaks: tuple[float, ...] = ()


def _zero(_: float) -> float:
    return 0.0


def constant(k: float) -> Driven:
    return Driven(Constant(k), lambda t: k, _zero, _zero)


def sine(a: float, f: float, phase: float, offset: float = 0.0) -> Driven:
    w = 2 * np.pi * f
    return Driven(
        Sine(a, f, phase, offset),
        lambda t: offset + a * np.sin(w * t + phase),
        lambda t: a * w * np.cos(w * t + phase),
        lambda t: -a * w**2 * np.sin(w * t + phase),
    )


def ramp(height: float, duration: float, offset: float, start: float) -> Driven:
    return Driven(
        Ramp(height, duration, offset, start),
        lambda t: offset + height * min(max((t - start) / duration, 0.0), 1.0),
        lambda t: height / duration if start <= t < start + duration else 0.0,
        _zero,
        (start, start + duration),
    )


def step(height: float, offset: float, start: float) -> Driven:
    return Driven(Step(height, offset, start), lambda t: offset + height * (t >= start), _zero, _zero, (start,))


def pulse(height: float, period: float, width: float, offset: float) -> Driven:
    edges = tuple(
        k * period + part for k in range(int(DURATION_S / period) + 1) for part in (0.0, width * period / 100)
    )
    return Driven(
        Pulse(height, period, width, offset),
        lambda t: offset + height * (np.searchsorted(edges, t, side="right") % 2 == 1),
        _zero,
        _zero,
        edges[1:],
    )


@dataclass(frozen=True)
class Friction:
    """Torque F against the shaft: sliding forward and backward, and the limits while it is stuck; T is what drives."""

    component: Component
    forward: Callable[[float, float, float], float]  # of T, |w|, t
    backward: Callable[[float, float, float], float]
    upper: Callable[[float, float], float]  # of T, t
    lower: Callable[[float, float], float]
    grounded: bool = False
    one_way: bool = False
    ratio: float = 1.0
    breaks: tuple[float, ...] = ()
    table: tuple[float, float, float, float] | None = None

    def when_moved(self, net: float, way: float, speed: float, t: float) -> float:
        """T where the shaft is moved `way` and needs the torque `net` besides friction."""
        if way == 0:
            return net
        if self.table is None:
            return net + (self.forward if way > 0 else self.backward)(0.0, speed, t)
        eta1, eta2, bf1, bf2 = self.table
        pick = max if way > 0 else min
        return pick((net + way * bf1) / eta1, eta2 * (net + way * bf2))


@dataclass(frozen=True)
class Case:
    """One drawn composition."""

    name: str
    train: DriveTrain
    reference: Driven | None
    rate: Callable[[float, float, float], float]
    start: tuple[float, float]
    friction: Friction
    link: str
    gear: float
    inertia: float
    first_inertia: float
    c: float
    d: float
    clutch: Driven
    mu: float
    breaks: tuple[float, ...]


def draw(seed: int, source: str = "", friction: str = "", link: str = "") -> Case:
    """Draw one composition; what is not named is drawn too."""
    rng = np.random.default_rng(seed)
    source = source or str(rng.choice(SOURCES))
    friction = friction or str(rng.choice(FRICTIONS))
    link = link or str(rng.choice(LINKS))
    part, driven, rate, start = _source(source, rng)
    element = _friction(friction, rng, peaks=link != "clutch")
    inertia, first = float(rng.uniform(0.2, 2)), float(rng.choice([0.0, 0.7]))
    gear = float(rng.choice([-1, 1]) * rng.uniform(0.3, 3)) if link == "gear" else 1.0
    c, d, mu = float(10 ** rng.uniform(1, 3)), float(10 ** rng.uniform(-1, 0.7)), float(rng.uniform(0.5, 8))
    pressed = constant(1.0)
    if link == "clutch" and rng.random() < 0.5:
        pressed = pulse(1.0, float(rng.uniform(0.3, 0.7)), float(rng.uniform(30, 70)), 0.0)
    parts: dict[str, Component] = {"source": part}
    if first:
        parts["first"] = Inertia(J=first)
    if link == "gear":
        parts["link"] = IdealGear(ratio=gear)
    elif link == "spring":
        parts["link"] = SpringDamper(c=c, d=d)
    elif link == "clutch":
        parts["link"] = Clutch(fn_max=mu, mu_pos=[[0, 1]], f_normalized=pressed.signal)
    free = link in ("spring", "clutch")
    still = {"phi": 0.0, "w": 0.0} if free and element.ratio == 1 else {}
    if link == "spring behind":
        train = DriveTrain.series(**parts)
        end = "first.flange_b" if first else "source.flange"
        if element.grounded:
            train = train.add("friction", element.component, flange_b=end).add(
                "ground", Fixed(), flange="friction.flange_a"
            )
        else:
            train = train.add("friction", element.component, flange_a=end)
            end = "friction.flange_b"
        train = train.add("link", SpringDamper(c=c, d=d), flange_a=end)
        train = train.add("body", Inertia(J=inertia, phi=0.0, w=0.0), flange_a="link.flange_b")
        c, d = c / element.ratio**2, d / element.ratio**2
    elif element.grounded:
        parts["body"] = Inertia(J=inertia, **still)
        train = DriveTrain.series(**parts).add("friction", element.component, flange_b="body.flange_b")
        train = train.add("ground", Fixed(), flange="friction.flange_a")
    else:
        parts["friction"] = element.component
        parts["body"] = Inertia(J=inertia, **({"phi": 0.0, "w": 0.0} if free else {}))
        train = DriveTrain.series(**parts)
    breaks = sorted({*(driven.breaks if driven else ()), *element.breaks, *pressed.breaks})
    return Case(
        f"{seed}: {source} - {link} - {friction}",
        train, driven, rate, start, element, link, gear, inertia / element.ratio**2, first, c, d, pressed, mu,
        tuple(t for t in breaks if 0 < t < DURATION_S),
    )  # fmt: skip


def _source(
    kind: str, rng: np.random.Generator
) -> tuple[Component, Driven | None, Callable[..., float], tuple[float, float]]:
    """The component, its signal, its acceleration at (t, angle, speed), and its angle and speed at the start."""
    name, _, shape = kind.partition(": ")
    size = float(rng.choice([-1, 1]) * rng.uniform(0.5, 8))
    at_rest = rng.random() < 0.4
    phase = float(rng.choice([0.0, np.pi])) if at_rest else float(rng.uniform(0, 2 * np.pi))
    offset = 0.0 if at_rest else float(rng.uniform(-2, 2))
    begin = float(rng.choice([0.0, rng.uniform(0.05, 0.4)]))
    f_crit = float(10 ** rng.uniform(0.5, 1.7))
    drawn = {
        "sine": lambda: sine(size, float(rng.uniform(0.7, 3)), phase, offset if "accel" not in kind else 0.0),
        "ramp": lambda: ramp(size, float(rng.uniform(0.2, 0.7)), float(rng.choice([0.0, offset, -size])), begin),
        "step": lambda: step(size, offset, begin),
        "pulse": lambda: pulse(
            size, float(rng.uniform(0.2, 0.6)), float(rng.uniform(20, 80)), -size / 2 if at_rest else offset
        ),
        "constant": lambda: constant(size),
    }
    if kind == "constant speed":
        speed = float(rng.choice([0.0, size]))
        return ConstantSpeed(speed), None, lambda t, phi, w: 0.0, (0.0, speed)
    ref = drawn[shape]()
    at0 = ref.value(0.0)
    crit = 2 * np.pi * f_crit
    if name == "exact speed":
        return Speed(ref.signal, exact=True), ref, lambda t, phi, w: ref.slope(t), (0.0, at0)
    if name == "speed":
        return Speed(ref.signal, f_crit=f_crit), ref, lambda t, phi, w: (ref.value(t) - w) * crit, (0.0, at0)
    if name == "exact position":
        return Position(ref.signal, exact=True), ref, lambda t, phi, w: ref.bend(t), (at0, ref.slope(0.0))
    if name == "position":
        return (
            Position(ref.signal, f_crit=f_crit),
            ref,
            lambda t, phi, w: ((ref.value(t) - phi) * crit - 1.3617 * w) * crit / 0.6180,
            (at0, 0.0),
        )
    if name == "accelerate":
        w0 = 0.0 if at_rest else offset
        return Accelerate(ref.signal, phi=0.0, w=w0), ref, lambda t, phi, w: ref.value(t), (0.0, w0)
    omega = float(rng.uniform(4, 18))
    f = omega / (2 * np.pi)
    accelerations = sine(-size * omega**2, f, phase)
    move = Move(Sine(size, f, phase), Sine(size * omega, f, phase + np.pi / 2), accelerations.signal)
    return (
        move,
        accelerations,
        lambda t, phi, w: accelerations.value(t),
        (
            size * np.sin(phase),
            size * omega * np.sin(phase + np.pi / 2),
        ),
    )


def _friction(kind: str, rng: np.random.Generator, peaks: bool) -> Friction:
    f0, f1 = float(rng.uniform(0.3, 5)), float(rng.uniform(0.01, 0.5)) if kind == "bearing over speed" else 0.0
    peak = float(rng.choice([1.0, rng.uniform(1.05, 1.6)])) if peaks else 1.0
    if kind == "lossy gear":
        eta1, eta2 = rng.uniform(0.6, 0.99, 2)
        bf1, bf2 = rng.uniform(0.1, 1.5, 2)
        ratio = float(rng.choice([-1, 1]) * rng.uniform(0.5, 2))

        def limit(T: float, way: float) -> float:
            values = (1 - eta1) * T + way * bf1, (1 - 1 / eta2) * T + way * bf2
            return float(max(values) if way > 0 else min(values))

        return Friction(
            LossyGear(ratio, [0, eta1, eta2, bf1, bf2]),
            lambda T, speed, t: limit(T, 1),
            lambda T, speed, t: limit(T, -1),
            lambda T, t: limit(T, 1),
            lambda T, t: limit(T, -1),
            ratio=ratio,
            table=(float(eta1), float(eta2), float(bf1), float(bf2)),
        )
    pressed = constant(1.0)
    if kind == "brake by a signal" or (kind in ("freewheel", "clutch to ground") and rng.random() < 0.5):
        pressed = (
            ramp(-1.0, float(rng.uniform(0.1, 0.4)), 1.0, float(rng.uniform(0, 0.5)))
            if rng.random() < 0.4
            else pulse(1.0, float(rng.uniform(0.2, 0.7)), float(rng.uniform(20, 80)), 0.0)
        )

    def torque(speed: float, t: float) -> float:
        return (f0 + f1 * speed) * max(pressed.value(t), 0.0)

    given = {"fn_max": f0, "mu_pos": [[0, 1]], "peak": peak, "f_normalized": pressed.signal}
    component: Component = {
        "bearing": lambda: BearingFriction([[0, f0]], peak=peak),
        "bearing over speed": lambda: BearingFriction([[0, f0], [1, f0 + f1]], peak=peak),
        "brake": lambda: Brake(**given),
        "brake by a signal": lambda: Brake(**given),
        "clutch to ground": lambda: Clutch(**given),
        "freewheel": lambda: OneWayClutch(**given),
    }[kind]()
    one_way = kind == "freewheel"

    def upper(T: float, t: float) -> float:
        if not one_way:
            return peak * torque(0.0, t)
        return max(peak, 1 + 1e-4) * torque(0.0, t) if pressed.value(t) > 0 else 1e-4 * f0

    return Friction(
        component,
        lambda T, speed, t: torque(speed, t),
        lambda T, speed, t: -torque(speed, t),
        upper,
        lambda T, t: -np.inf if one_way else -peak * torque(0.0, t),
        grounded=kind in ("clutch to ground", "freewheel"),
        one_way=one_way,
        breaks=pressed.breaks,
    )


# ---- the equations ------------------------------------------------------------------------------------------


class Truth:
    """Integrates a case piece by piece; y = (angle and speed of the source, angle and speed of the body)."""

    def __init__(self, case: Case, times: Array) -> None:
        self.case, self.times = case, times
        self.events: list[float] = []
        self.body = self.slip = 0.0  # direction of sliding against the ground, and of the clutch; 0: stuck
        self.way = 0.0  # direction of the prescribed motion
        self.rows = np.full((len(times), 6), np.nan)  # the state, T at the body, F

    def run(self) -> Array:
        case = self.case
        source, prescribed = case.start, case.link in ("rigid", "gear")
        y = np.array([*source, *((np.array(source) / case.gear) if prescribed else (0.0, 0.0))])
        t = 0.0
        bounds = [*case.breaks, DURATION_S]
        self._decide(t, y)
        for _ in range(3000):
            bound = next((b for b in bounds if b > t + 1e-12), None)
            if bound is None:
                return self.rows
            t, y = self._piece(t, y, bound)
        raise AssertionError(f"{case.name}: no end")

    def _piece(self, t: float, y: Array, bound: float) -> tuple[float, Array]:
        inside = self.times[(self.times >= t - 1e-12) & (self.times < bound - 1e-12)]
        last = bound == DURATION_S
        end = bound - 1e-14  # left-hand limits of signals up to the bound
        events = self._events()
        solution = solve_ivp(
            self._rate_above_underflow, (t, end), y, method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.005,
            events=events, dense_output=True,
        )  # fmt: skip
        assert solution.success
        reached = solution.t[-1]
        for when in inside[inside <= reached + 1e-13]:
            self._note(when, np.asarray(solution.sol(min(max(when, t), reached))))
        now = solution.y[:, -1].copy()
        if solution.status == 0:
            if last:
                self._note(self.times[-1], now)
            self._decide(bound, now)
            return bound, now
        which = next(i for i, times in enumerate(solution.t_events) if len(times))
        self.events.append(reached)
        self._after(events[which], reached, now)
        return reached, now

    def _rate_above_underflow(self, t: float, y: Array) -> Array:
        """What has died away is zero: scipy squares it in its estimate of the error, and divides nothing by nothing."""
        rate = np.asarray(self._rate(t, y))
        return np.where(np.abs(rate) < 1e-100, 0.0, rate)

    def _note(self, when: float, y: Array) -> None:
        T, F, _ = self._torques(when, y)
        self.rows[np.argmin(np.abs(self.times - when))] = (*y, T, F)

    @property
    def _moved(self) -> bool:
        """Whether the body goes as the source does."""
        return self.case.link in ("rigid", "gear", "spring behind") or (self.case.link == "clutch" and self.slip == 0)

    def _torques(self, t: float, y: Array) -> tuple[float, float, float]:
        """Torque of the link on the body, friction, and the body's acceleration."""
        case, law = self.case, self.case.friction
        theta, omega, phi, w = y
        if case.link == "spring behind":
            net = case.c * (theta - phi) + case.d * (omega - w)
            T = law.when_moved(net, self.way, abs(omega), t)
            return T, T - net, net / case.inertia
        if self._moved:
            a = case.rate(t, theta, omega) / case.gear
            way = self.way
            T = law.when_moved(case.inertia * a, way, abs(omega / case.gear), t)
            return T, T - case.inertia * a, a
        spring = case.c * (theta - phi) + case.d * (omega - w)
        T = spring if case.link == "spring" else -self.slip * self._clutch(t)
        if self.body == 0:
            return T, T, 0.0
        F = (law.forward if self.body > 0 else law.backward)(T, abs(w), t)
        return T, F, (T - F) / case.inertia

    def _clutch(self, t: float) -> float:
        return self.case.mu * max(self.case.clutch.value(t), 0.0)

    def _way(self, t: float, y: Array) -> float:
        """Direction of the prescribed motion: of its speed, else of its acceleration from now on."""
        omega = y[1] / self.case.gear
        if abs(omega) > 1e-9:
            way = np.sign(omega)
        else:
            soon = [self.case.rate(t + ahead, y[0], y[1]) / self.case.gear for ahead in (0.0, 1e-6)]
            way = next((np.sign(a) for a in soon if abs(a) > 1e-6), 0.0)
        if self.case.friction.one_way and way < 0:
            raise Contradiction
        return float(way)

    def _rate(self, t: float, y: Array) -> list[float]:
        return [y[1], self.case.rate(t, y[0], y[1]), y[3], self._torques(t, y)[2]]

    def _events(self) -> list[Callable[[float, Array], float]]:
        case, law = self.case, self.case.friction
        out: list[Callable[[float, Array], float]] = []

        def add(name: str, function: Callable[[float, Array], float], direction: float) -> None:
            def event(t: float, y: Array) -> float:
                return float(function(t, y)) + SLACK * 1e-2  # not zero where it just began

            event.terminal, event.direction, event.__name__ = True, direction, name  # type: ignore[attr-defined]
            out.append(event)

        if self._moved:
            if case.link == "clutch":
                add("slip", lambda t, y: self._clutch(t) + SLACK - abs(self._torques(t, y)[0]), -1)
            if self.way:
                add("turn", lambda t, y: y[1] / case.gear * self.way, -1)
            return out
        if case.link == "clutch":
            add("close", lambda t, y: (y[3] - y[1]) * self.slip, -1)
        if self.body:
            add("stop", lambda t, y: y[3] * self.body, -1)
        else:
            add("forward", lambda t, y: law.upper(self._torques(t, y)[0], t) + SLACK - self._torques(t, y)[0], -1)
            add(
                "backward",
                lambda t, y: min(self._torques(t, y)[0] - law.lower(self._torques(t, y)[0], t), 1e9) + SLACK,
                -1,
            )
        return out

    def _after(self, event: Callable[[float, Array], float], t: float, y: Array) -> None:
        name = event.__name__
        if name == "forward":
            self.body = 1.0
        elif name == "backward":
            self.body = -1.0
        elif name == "slip":
            self._saturate(t, y)
        else:
            if name == "stop":
                y[3] = 0.0
            elif name == "close":
                y[3] = y[1]
            elif name == "turn":
                y[1] = 0.0
                if self._moved and self.case.link != "spring behind":
                    y[3] = 0.0
            self._decide(t, y)

    def _saturate(self, t: float, y: Array) -> None:
        self.slip = -float(np.sign(self._torques(t, y)[0]))
        self._rest(t, y)

    def _rest(self, t: float, y: Array) -> None:
        """Direction of the body against the ground where the torque of the link is known."""
        law = self.case.friction
        if abs(y[3]) > 1e-9:
            self.body = float(np.sign(y[3]))
            return
        self.body = y[3] = 0.0
        T = self._torques(t, y)[0]
        self.body = float(T - law.upper(T, t) > SLACK) - float(law.lower(T, t) - T > SLACK)

    def _decide(self, t: float, y: Array) -> None:
        if self.case.link in ("rigid", "gear", "spring behind"):
            self.way = self._way(t, y)
            return
        if self.case.link == "clutch":
            slip = y[3] - y[1]
            self.slip = float(np.sign(slip)) if abs(slip) > 1e-9 else 0.0
            if self.slip == 0:
                y[3] = y[1]
                try:
                    self.way = self._way(t, y)
                    needed = self._torques(t, y)[0]
                except Contradiction:
                    needed = -np.inf
                if abs(needed) <= self._clutch(t) + SLACK:
                    return
                self.slip = -float(np.sign(needed))
        self._rest(t, y)
