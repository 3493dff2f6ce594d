"""What a column's name says: quantity, side of the gear and unit, in the words of controllers, robots and loggers.

All words stand here. A word that stands nowhere here is part of the name of what was measured (`elbow`, `ODrive 0`).
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from signals.columns.units import BRACKETS, COUNT, OTHERS, QUANTITIES, TIMES, WITH_FACTOR, unit_of
from signals.telemetry import CHANNELS, TIME

POSITION, SPEED, TORQUE, CURRENT, TEMPERATURE, CLOCK = "position", "speed", "torque", "current", "temperature", "time"
MOTOR, LOAD, SHAFT, REFERENCE, KNOWN = "motor", "load", "shaft", "reference", "known"


def _all(words: str, meaning: str) -> dict[str, str]:
    return dict.fromkeys(words.split(), meaning)


def _set(*words: str) -> frozenset[str]:
    return frozenset(" ".join(words).split())


QUANTITY_WORDS: Mapping[str, str] = MappingProxyType(
    {
        **_all("time timestamp timestamps stamp t clock zeit zeitstempel uhrzeit", CLOCK),
        **_all("position positions pos angle winkel drehwinkel winkellage lage theta phi q", POSITION),
        **_all("speed velocity velocities vel velo omega qd dq qdot erpm", SPEED),
        **_all("geschwindigkeit winkelgeschwindigkeit drehzahl", SPEED),
        **_all("torque torques trq tq moment drehmoment effort efforts tau force kraft", TORQUE),
        **_all("current currents curr strom iq", CURRENT),
        **_all("temperature temp temperatur", TEMPERATURE),
    }
)
SYMBOLS: Mapping[str, str] = MappingProxyType({**_all("n v w", SPEED), "m": TORQUE, "i": CURRENT})
"""Letters that are a quantity where a unit of that quantity stands beside them."""
SIDE_WORDS: Mapping[str, str] = MappingProxyType(
    {
        **_all("motor mot rotor antrieb antriebsseite antriebsseitig", MOTOR),
        **_all("load output out link abtrieb abtriebsseite abtriebsseitig lastseite lastseitig", LOAD),
        **_all("shaft welle", SHAFT),
        **_all("reference ref target command commanded cmd desired setpoint set demand demanded goal", REFERENCE),
        **_all("soll sollwert", REFERENCE),
        **_all("known", KNOWN),
    }
)
NEUTRAL = _set(
    "actual act ist istwert measured meas present feedback fbk fb estimate estimated est value val values wert",
    "average averaged avg filtered filter filt smoothed nach joint joints axis axes achse gelenk encoder enc state",
    "states control controller data field signal drive actuator servo angular rotational rotary mech mechanical",
    "side seite of der des am per as",
)
"""Words that say nothing of which channel a column is."""
BEFORE_A_NUMBER = _set("a j ax id")
"""Words that say nothing where a number follows (A1, J1)."""
DOUBTFUL = _set("input in sensor transducer")
"""Words that leave open which side is meant: a drive's input is its command, that of a gear its motor."""
NEVER = _set(
    "error err deviation following lag limit limits lim max min maximum minimum offset gain kp ki kd acceleration",
    "accel acc jerk qdd ddq ddot power voltage volt volts status mode warning fault tcp cartesian tool pose ext",
    "external friction ripple phase bus dc supply battery variance cov covariance std window d duty pwm index idx",
    "sampling cycle period execution duration delay ff feedforward disturbance gravity header seq nsecs nanosec",
    "nanosecs ambient cpu board mosfet fet fehler schleppfehler grenze beschleunigung leistung spannung delta diff dt",
    "loss losses rated nominal peak",
)
"""Words of what is no channel."""
DEFINED: Mapping[str, str] = MappingProxyType({"__time": "s", "%time": "ns", "rosbagtimestamp": "ns", "ms_today": "ms"})
"""Clocks whose unit the maker's definition tells: PlotJuggler, rostopic, rosbag, VESC Tool."""
SI_SYMBOLS: Mapping[str, str] = MappingProxyType(
    {"q": "rad", "qd": "rad/s", "dq": "rad/s", "qdot": "rad/s", "tau": "N.m"}
)
"""Symbols of robot dynamics, which are in SI wherever robots are programmed."""
FAMILIES: tuple[tuple[re.Pattern[str], Mapping[str, str]], ...] = (
    (  # ROS: sensor_msgs/JointState, with units by REP 103; nobody else calls a torque an effort
        re.compile(r"(.*[^a-z])?efforts?[\[\]\d_]*"),
        {
            **dict.fromkeys(("position", "positions"), "rad"),
            **dict.fromkeys(("velocity", "velocities"), "rad/s"),
            **dict.fromkeys(("effort", "efforts"), "N.m"),
        },
    ),
    (re.compile(r"actual_qd?(_?\d+)?"), {"timestamp": "s", "moment": "N.m", "torque": "N.m"}),  # Universal Robots: RTDE
    (  # ODrive: turns, whatever the encoder
        re.compile(r"(.*[^a-z])?(iq_measured|pos_estimate)"),
        {"pos": "rev", "vel": "rev/s", "torque": "N.m"},
    ),
)
"""By a name that only one maker uses: the units of names of his."""
OF_UNITS: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("rad", "mrad", "deg", "rev"), POSITION),
        **dict.fromkeys(("rad/s", "deg/s", "rev/s", "rpm"), SPEED),
        **dict.fromkeys(("N.m", "mN.m"), TORQUE),
    }
)
"""Units that tell a quantity where no word does."""
FITTING: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        CLOCK: tuple(TIMES),
        POSITION: (*QUANTITIES["rad"], COUNT),
        SPEED: tuple(QUANTITIES["rad/s"]),
        TORQUE: (*QUANTITIES["N m"], *WITH_FACTOR),
        CURRENT: WITH_FACTOR,
        TEMPERATURE: tuple(QUANTITIES["Cel"]),
    }
)
ALL_WORDS = frozenset({*QUANTITY_WORDS, *SIDE_WORDS, *NEUTRAL, *NEVER})
COMPOUND = re.compile("|".join(sorted((word for word in ALL_WORDS if len(word) > 2), key=len, reverse=True)))
LONGEST_NAME = 200
"""Characters of a name that may be a channel's."""
BRACKETED = re.compile(r"\[([^\[\]]*)\]|\(([^()]*)\)|<([^<>]*)>|\{([^{}]*)\}")
BESIDE = re.compile(r"(?:\s+in\s+|\s+/\s+|,\s+|:\s*)(\S+(?: \S+)?)\s*$")
"""A unit behind the name, as in `n / min-1`, `speed in rpm`."""
NUMBERED = re.compile(r"0x[0-9a-f]+|\b[rp]\d{2,5}\b(\[\d+\])?", re.IGNORECASE)
"""Numbers of objects of a bus, and of parameters of a drive."""
TOKEN = re.compile(r"[^\W\d_]+|\d+|%|°")
HUMP = re.compile(r"(?<=[a-zäöü])(?=[A-ZÄÖÜ])|(?<=[A-Z])(?=[A-Z][a-z])")


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    Args:
        channel: which channel the column is.
        unit: as in a channel map; None where it is not told.
        label: words and numbers for what was measured, such as an axis.
        word: the word for the quantity.
        needed: what of `NEEDED` has to be known beside the unit; else empty.
        open: what leaves the channel itself in doubt, in words; else empty.
        side: of the gear, where the name says it; else empty.
    """

    channel: str
    unit: str | None
    label: tuple[str, ...] = ()
    word: str = ""
    needed: str = ""
    open: str = ""
    side: str = ""

    @property
    def is_sure(self) -> bool:
        """Whether the column can be read by what its name says."""
        return self.unit is not None and not self.needed and not self.open


@dataclass(frozen=True)
class Needed:
    """What has to be known beside the unit.

    Args:
        key: of a channel map.
        what: the column is, in words.
        constant: that the key is, and where it is found.
    """

    key: str
    what: str
    constant: str


NEEDED: Mapping[str, Needed] = MappingProxyType(
    {
        "A": Needed(
            "factor",
            "a current: the torque per ampere is needed",
            "N m per unit of this column: the motor's torque constant (data sheet, or rated torque over rated current) "
            "or the drive's gain",
        ),
        "%": Needed(
            "factor",
            "a share of a torque: that torque is needed",
            "N m per unit of this column: the rated torque (data sheet, drive parameters) over what stands for it",
        ),
        COUNT: Needed(
            "counts_per_rev",
            "in counts: the counts per turn are needed",
            "counts per turn of the encoder (data sheet, drive parameters)",
        ),
        "erpm": Needed("factor", "electrical: the pole pairs are needed", "1 / pole pairs of the motor"),
    }
)
"""By unit or word: what has to be known of it."""


def meaning_of(name: str, unit_below: str = "") -> Meaning | None:
    """Return what a column's name, and the unit below it, say; None if the column is no channel.

    >>> meaning_of("Torque [Nm]").channel, meaning_of("Torque [Nm]").unit
    ('motor_torque_nm', 'N.m')
    >>> meaning_of("output_pos_deg").channel, meaning_of("following error [deg]")
    ('load_position_rad', None)
    """
    if not name.strip() and unit_of(unit_below) in TIMES:
        return Meaning(TIME, unit_of(unit_below))
    if name.lower() in DEFINED:
        return Meaning(TIME, DEFINED[name.lower()])
    said = _said(name, unit_below) if len(name) <= LONGEST_NAME else None
    if said is None:
        return None
    quantity, side, meaning = said
    if quantity == CLOCK:
        return replace(meaning, channel=TIME)
    channel = BY_MEANING.get((side, TORQUE if quantity == CURRENT else quantity))
    return None if channel is None else replace(meaning, channel=channel)


def _said(name: str, unit_below: str) -> tuple[str, str, Meaning] | None:
    """Quantity, side, and the rest of the meaning."""
    text, units = _without_units(NUMBERED.sub(" ", name))
    below = unit_below.strip(BRACKETS)
    units = units or ([below] if below else [])
    if any(unit_of(each) is None for each in units):
        return None
    tokens = re.sub(r"\bi q\b", "iq", " ".join(_tokens(text))).split()
    unit = unit_of(units[0]) if units else None
    if unit is None:
        unit, tokens = _trailing_unit(tokens)
    if not NEVER.isdisjoint(tokens):
        return None
    quantities, sides, label, doubts = _sorted(tokens, unit)
    word = quantities[-1] if quantities else ""
    quantity = {**SYMBOLS, **QUANTITY_WORDS}.get(word) or OF_UNITS.get(unit or "", "")
    if not quantity and LOAD in sides and unit in (None, "%"):  # how much of its torque a servo gives
        quantity, unit, sides = TORQUE, "%", [each for each in sides if each != LOAD]
    if not quantity:
        return None
    side, doubt = _side(quantity, sides)
    if len({QUANTITY_WORDS.get(each, each) for each in quantities} - {CURRENT}) > 1:
        doubt = "names two quantities"
    if quantity == CLOCK and unit not in (None, *TIMES):  # T [°C]
        return None
    if unit not in FITTING[quantity]:
        unit = SI_SYMBOLS.get(word) if unit is None else None
    if quantity == CURRENT:
        unit = unit or "A"
    if word == "erpm":
        unit = "rpm"
    needed = next((each for each in (word, unit or "") if each in NEEDED), "")
    if doubts:
        doubt = f"leaves the side open ({doubts[0]})"
    said = side if side in sides else ""
    return quantity, side, Meaning("", unit, tuple(label), word, needed, doubt, said)


def _sorted(tokens: list[str], unit: str | None) -> tuple[list[str], list[str], list[str], list[str]]:
    """The words that name a quantity, the sides that are named, what is left as a label, and words that leave doubt."""
    quantities, sides, label, doubts = [], [], [], []
    for place, token in enumerate(tokens):
        if token in QUANTITY_WORDS or (token in SYMBOLS and unit in FITTING[SYMBOLS[token]]):
            quantities.append(token)
        elif token in SIDE_WORDS:
            sides.append(SIDE_WORDS[token])
        elif token in DOUBTFUL:
            doubts.append(token)
        elif token not in NEUTRAL and not (
            token in BEFORE_A_NUMBER and "".join(tokens[place + 1 : place + 2]).isdigit()
        ):
            label.append(token)
    return quantities, sides, label, doubts


def _side(quantity: str, sides: list[str]) -> tuple[str, str]:
    """The side as in `BY_MEANING`, and what is in doubt about it."""
    if quantity in (CLOCK, TEMPERATURE):
        return "", ""
    named = {each for each in sides if each != SHAFT or quantity == TORQUE}
    if quantity in (TORQUE, CURRENT) and REFERENCE in named:
        return MOTOR, "is what the drive was asked for"
    if named == {REFERENCE, MOTOR}:
        return REFERENCE, ""
    if len(named) > 1:
        return next(iter(each for each in sides if each in named)), "names two sides"
    return next(iter(named), MOTOR), ""


def _without_units(text: str) -> tuple[str, list[str]]:
    """The text without units in brackets or behind a sign, and these; what else is in brackets stays."""
    units: list[str] = []

    def taken(match: re.Match[str]) -> str:
        content = next(each for each in match.groups() if each is not None).strip()
        if content and (unit_of(content) is not None or content in OTHERS):
            units.append(content)
            return " "
        return f" {content} "

    text = BRACKETED.sub(taken, text)
    match = BESIDE.search(text)
    if not units and match and unit_of(match[1]) is not None:
        return text[: match.start()], [match[1]]
    return text, units


def _tokens(text: str) -> Iterator[str]:
    for run in TOKEN.findall(text):
        for part in HUMP.split(run) if run.upper() != run and unit_of(run) is None else [run]:
            token = part.lower()
            yield from [token] if token in ALL_WORDS or unit_of(part) else _parts(token)


def _parts(token: str) -> list[str]:
    """The words of a compound (`drehzahlistwert`, `actpos`); the token itself where it is none."""
    parts: list[str] = []
    place = 0
    while place < len(token):
        match = COMPOUND.match(token, place)
        if match:
            parts.append(match[0])
            place = match.end()
        elif parts and token[place] == "s":  # antriebsdrehzahl
            place += 1
        else:
            return [token]
    return parts


def _trailing_unit(tokens: list[str]) -> tuple[str | None, list[str]]:
    """The unit in which a name ends, but for a number (`pos_deg`, `speed_rad_s_2`), and the tokens before and after.

    Of one letter it is that of a time or a current alone.
    """
    end = len(tokens)
    while end and tokens[end - 1].isdigit():
        end -= 1
    tokens, numbers = tokens[:end], tokens[end:]
    for count in (3, 2, 1):
        last = [each for each in tokens[-count:] if each != "per"]
        written = "/".join(last) if "".join(last) not in ("nm", "mnm") else "".join(last)
        unit = unit_of(written) if len(tokens) > count or written == "rpm" else None
        before = {QUANTITY_WORDS.get(each) for each in tokens[:-count]}
        if len(written) == 1:
            unit = "s" if written == "s" and CLOCK in before else "A" if written == "a" and CURRENT in before else None
        if unit is not None and (unit in TIMES) == (CLOCK in before):
            return unit, tokens[:-count] + numbers
    return None, tokens + numbers


def _by_meaning() -> Mapping[tuple[str, str], str]:
    """Channels by side and quantity, as their own names say them."""
    found = {}
    for channel in CHANNELS:
        said = _said(channel, "")
        if said is not None:
            found[said[1], said[0]] = channel
    return MappingProxyType(found)


BY_MEANING = _by_meaning()
