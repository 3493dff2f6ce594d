"""Numbers as a technician reads them: as many digits as their interval deserves, angles also in degrees."""

from __future__ import annotations

import math

NO_BREAK, MINUS = "\N{NO-BREAK SPACE}", "\N{MINUS SIGN}"
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SMALL = 1e-4  # below, powers of ten
UNITS = {"kg m2": "kg m²", "1/rad2": "1/rad²", "1": ""}
WORDS = {
    "gap_rad": "gap",
    "depth_rad": "depth",
    "width_rad": "width",
    "angle_rad": "angle of the gear",
    "angle_from_middle_rad": "angle from the middle of the travel",
    "flank": "flank",
    "cubic_per_rad2": "hardening",
    "rate_per_s": "change of friction per second",
    "fraction": "share",
    "order": "times per turn of the motor",
    "torque_n_m": "torque",
    "share": "share of the load's inertia",
    "motor_torque_nm": "motor torque",
    "load_torque_nm": "torque at the load",
    "load_position_rad": "load position",
}
ENDINGS = ("_n_m_s_per_rad", "_n_m_per_rad", "_kg_m2", "_rad_s", "_n_m", "_nm", "_rad", "_hz", "_s", "_kg", "_m")


def words_of(name: str) -> str:
    """Name of a parameter or a channel in words; its unit stands beside its value.

    >>> words_of("stages.output.stiffness_n_m_per_rad"), words_of("gap_rad")
    ('output: stiffness', 'gap')
    """
    if name in WORDS:
        return WORDS[name]
    ending = next((one for one in ENDINGS if name.endswith(one)), "")
    *place, last = name.removesuffix(ending).removeprefix("stages.").split(".")
    return ": ".join([*place, last]).replace("_", " ")


def unit_in_words(unit: str) -> str:
    """A unit with its powers raised; nothing for 1."""
    return UNITS.get(unit, unit)


def number(value: float, half: float = 0.0) -> str:
    """`value` to the digits that `half`, its uncertainty, leaves it, or to three where that is not known.

    >>> number(0.0011912, 0.00009), number(152712.0, 1200.0), number(39.44)
    ('0.00119', '152\\u202f700', '39.4')
    >>> number(1.832e-5, 2e-6), number(0.0)
    ('1.83 × 10⁻⁵', '0')
    """
    if value == 0.0 and half == 0.0:
        return "0"
    size = max(abs(value), half)
    if size < SMALL:
        power = math.floor(math.log10(size))
        return f"{number(value / 10.0**power, half / 10.0**power)} × 10{str(power).translate(RAISED)}"
    last = math.floor(math.log10(half / 3.0)) if half > 0.0 else math.floor(math.log10(abs(value))) - 2
    last = max(last, math.floor(math.log10(size)) - 4)  # nobody reads more
    text = f"{round(value, -last):,.{max(-last, 0)}f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    return text.replace("-", MINUS)


def interval(low: float, high: float) -> str:
    """Both ends with the digits of their distance; a dash where there is none.

    >>> interval(0.0011, 0.00128), interval(1.0, 1.0)
    ('0.00110 to 0.00128', '–')
    """
    half = 0.5 * (high - low)
    return f"{number(low, half)} to {number(high, half)}" if half > 0.0 else "–"


def angle(value_rad: float, half_rad: float = 0.0, *, unit_of: float | None = None) -> str:
    """An angle in degrees, or in minutes of arc where it is small; or in the unit of another that it stands beside.

    >>> angle(2.7, 0.001), angle(0.0012, 0.0001), angle(2e-5), angle(2e-5, unit_of=0.003)
    ('154.70°', '4.1\\xa0arc min', '4.13\\xa0arc s', '0.0688\\xa0arc min')
    """
    times, unit = _angle_unit(value_rad if unit_of is None else unit_of, half_rad)
    return f"{number(times * value_rad, times * half_rad)}{unit}"


def angle_interval(low_rad: float, high_rad: float) -> str:
    """Both ends of an interval of angles, in the unit of its middle.

    >>> angle_interval(0.0011, 0.00128)
    '3.8 to 4.4\\xa0arc min'
    """
    times, unit = _angle_unit(0.5 * (low_rad + high_rad), 0.5 * (high_rad - low_rad))
    return f"{interval(times * low_rad, times * high_rad)}{unit}"


def _angle_unit(value_rad: float, half_rad: float) -> tuple[float, str]:
    """Degrees, or minutes or seconds of arc where it is small: how many a radian has, and the unit."""
    degrees, half = abs(math.degrees(value_rad)), math.degrees(half_rad)
    times, unit = (
        (1.0, "°")
        if max(degrees, half) >= 0.2
        else (60.0, f"{NO_BREAK}arc min")
        if degrees >= 0.2 / 60.0
        else (3600.0, f"{NO_BREAK}arc s")
    )
    return math.degrees(times), unit


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent.

    >>> percent(0.95), percent(-0.024, 1)
    ('95\\xa0%', '−2.4\\xa0%')
    """
    return f"{100.0 * share:.{digits}f}{NO_BREAK}%".replace("-", MINUS)


def changed(before: float, after: float, digits: int = 0) -> str:
    """By what share something has changed, with its sign.

    >>> changed(2.0, 3.0), changed(2.0, 1.0)
    ('+50\\xa0%', '−50\\xa0%')
    """
    share = after / before - 1.0
    return f"{'+' if share > 0.0 else ''}{percent(share, digits)}"


def sure(probability: float) -> str:
    """A probability in words.

    >>> sure(0.95), sure(0.66)
    ('very likely', 'more likely than not')
    """
    steps = ((0.9, "very likely"), (0.75, "likely"), (0.5, "more likely than not"))
    return next((text for least, text in steps if probability >= least), "only suspected")


def likely(probability: float, *, calibrated: bool) -> str:
    """How sure one may be, in words and as a number: in per cent only where that is calibrated.

    >>> likely(0.954, calibrated=True), likely(0.954, calibrated=False)
    ('very likely (95\\xa0%)', 'very likely (95\\xa0%, not calibrated)')
    """
    return f"{sure(probability)} ({percent(probability)}{'' if calibrated else ', not calibrated'})"


def named(mechanism: str, location: str | None = None) -> str:
    """A mechanism, and where it sits.

    >>> named("tooth_damage", "output"), named("encoder_error")
    ('tooth damage at output', 'encoder error')
    """
    name = mechanism.replace("_", " ")
    return f"{name} at {location}" if location else name
