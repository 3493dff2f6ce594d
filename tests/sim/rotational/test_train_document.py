"""Drive trains as documents: what is read is what was composed, and what is wrong is said with its line."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest
import tomli_w

from sim.errors import CompositionError, ParameterError, SimulationError
from sim.rotational.component import Component, Signal
from sim.rotational.components import COMPONENTS, ElastoBacklash, Inertia, LossyGear, Sine, Torque
from sim.rotational.drive_train import DriveTrain
from sim.rotational.train_document import SIGNALS, read_train
from sim.solver import simulate

PAPER = """\
schema = "gearcase-train/1"
series = ["drive", "motor", "gear", "backlash", "load"]

[components.drive]
type = "Torque"
tau = {type = "Sine", amplitude = 12, f = 0.5}

[components.motor]
type = "Inertia"
J = 0.6

[components.gear]
type = "LossyGear"
ratio = 100
lossTable = [
    [0, 0.9, 0.9, 0.9, 0.9],
]

[components.backlash]
type = "ElastoBacklash"
c = 1e5

[components.load]
type = "Inertia"
J = 30
"""
COMPOSED = DriveTrain.series(
    drive=Torque(Sine(12, 0.5)),
    motor=Inertia(J=0.6),
    gear=LossyGear(ratio=100, lossTable=[0, 0.9, 0.9, 0.9, 0.9]),
    backlash=ElastoBacklash(c=1e5),
    load=Inertia(J=30),
)
CONNECTED = PAPER.replace(
    'series = ["drive", "motor", "gear", "backlash", "load"]',
    """\
series = ["motor", "gear", "backlash", "load"]
connections = [
    ["drive.flange", "motor.flange_a"],
]""",
)


@pytest.mark.parametrize("text", [PAPER, CONNECTED])
def test_the_paper_s_drive_moves_as_the_one_composed_in_python(text: str) -> None:
    read, composed = (simulate(train, 2.0, 1000.0) for train in (read_train(text), COMPOSED))
    assert read.channels.keys() == composed.channels.keys()
    assert read.events == composed.events
    for name in composed.channels:
        np.testing.assert_allclose(read[name], composed[name], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("J = 0.6", "J = -0.6", "line 10: components.motor.J: must be > 0 kg.m2, got -0.6"),
        ("J = 0.6", "", "line 8: components.motor.J: missing; Inertia has no default of it"),
        ("J = 0.6", "J = 0.6\nphy = 1", "line 11: components.motor.phy: unknown key; did you mean 'phi'?"),
        ("J = 0.6", 'J = "big"', "line 10: components.motor.J: must be > 0 kg.m2, got 'big'"),
        ("J = 0.6", "J = 0.6\na = 1", "line 11: components.motor.a: a start acceleration is not taken"),
        ('"LossyGear"', '"LosyGear"', "line 13: components.gear.type: no type 'LosyGear'; did you mean 'LossyGear'?"),
        ('"LossyGear"', "7", "line 13: components.gear.type: no type 7; known: "),
        ('type = "LossyGear"\n', "", 'line 12: components.gear: must be a table with type = "..."'),
        ("[0, 0.9,", "[0, 1.9,", "line 15: components.gear.lossTable[0][1]: must be > 0 and <= 1, got 1.9"),
        ("[0, 0.9,", "[0,", "line 15: components.gear.lossTable: row 0 must have 5 numbers"),
        ("f = 0.5", "f = 0", "line 6: components.drive.tau.f: must be > 0 Hz, got 0"),
        ("f = 0.5", "freq = 1", "line 6: components.drive.tau.freq: unknown key; known: amplitude, f,"),
        ('"Sine"', '"Sin"', "line 6: components.drive.tau.type: no type 'Sin'; did you mean 'Sine'?"),
        ('{type = "Sine", amplitude = 12, f = 0.5}', "12", "line 6: components.drive.tau: must be a signal, a"),
        ('{type = "Sine", amplitude = 12, f = 0.5}', '{type = "Sampled", values = ["a", 1], sample_rate_hz = 1}',
         "line 6: components.drive.tau: Sampled cannot have these parameters: could not convert"),
        ("[components.gear]", "[component.gear]", "line 12: component: unknown key; did you mean 'components'?"),
        ("[components.gear]", '[components."a,b"]', "line 12: components.a,b: must be a name of letters"),
        ("train/1", "train/2", "line 1: schema: must be 'gearcase-train/1', got 'gearcase-train/2'"),
        ("J = 0.6", "J = 0.6.1", "this is no TOML: Expected newline or end of document after a statement (at line 10"),
    ],
)  # fmt: skip
def test_a_wrong_parameter_is_said_with_its_line(right: str, wrong: str, said: str) -> None:
    assert right in PAPER
    with pytest.raises(ParameterError) as refused:
        read_train(PAPER.replace(right, wrong))
    assert str(refused.value).startswith(said)


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ('"gear", "back', '"gaer", "back', "line 2: series: no component 'gaer'; did you mean 'gear'?"),
        ('"gear", "back', '"motor", "back', "line 2: series: motor stands there twice"),
        ('["motor", "gear", "backlash", "load"]', "7", "line 2: series: must be a list, got 7"),
        ("drive.flange", "drive.flange_c", "line 4: connections: drive.flange_c: no such flange; did you mean"),
        ("motor.flange_a", "moter.flange_a", "line 4: connections: no component 'moter'; did you mean 'motor'?"),
        (', "motor.flange_a"', "", "line 4: connections: a connection joins two or more flanges"),
        ('"motor.flange_a"', "7", "line 3: connections: must be lists of flanges, got ['drive.flange', 7]"),
    ],
)  # fmt: skip
def test_a_wrong_connection_is_said_with_its_line(right: str, wrong: str, said: str) -> None:
    assert right in CONNECTED
    with pytest.raises(CompositionError) as refused:
        read_train(CONNECTED.replace(right, wrong))
    assert str(refused.value).startswith(said)


def test_tables_may_stand_in_one_line_each_and_names_may_be_any() -> None:
    text = 'series = ["cls", "at"]\n[components]\ncls = {type = "Inertia", J = 1}\nat = {type = "Fixed", phi0 = "x"}'
    with pytest.raises(ParameterError, match=r"^line 4: components\.at\.phi0: must be a finite number rad, got 'x'"):
        read_train(text)
    assert list(read_train(text.replace('"x"', "0")).components) == ["cls", "at"]


def table_of(part: Component | Signal) -> dict[str, Any]:
    """A component or a signal as a table of a document."""
    given = {field.name: getattr(part, field.name) for field in fields(part) if field.init}  # type: ignore[arg-type]
    values = {key: table_of(value) if isinstance(value, Signal) else value for key, value in given.items()}
    plain = {key: np.asarray(value).tolist() for key, value in values.items() if isinstance(value, tuple | np.ndarray)}
    return {"type": type(part).__name__, **{key: x for key, x in values.items() if x is not None}, **plain}


def drawn(kind: type, rng: np.random.Generator) -> Any:
    """A component or a signal with parameters drawn; again where it refuses what was drawn."""
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind) if field.init]
    while True:
        try:
            return kind(**{name: value(name, hints[name], rng) for name in names})
        except SimulationError:
            continue


def value(name: str, hint: Any, rng: np.random.Generator) -> Any:
    """A parameter, by what it may be."""
    tables: dict[str, Callable[[], object]] = {
        "lossTable": lambda: [0.0, *rng.uniform(0.5, 1.0, 4).tolist()],
        "tau_pos": lambda: [[0.0, float(rng.random())], [1.0, float(rng.random())]],
        "mu_pos": lambda: [[0.0, float(rng.random())]],
        "values": lambda: rng.random(5),
    }
    if name in tables:
        return tables[name]()
    kinds = get_args(hint) or (hint,)
    if get_origin(hint) is Literal:
        return str(rng.choice(kinds))
    wanted = tuple(kind for kind in kinds if issubclass(kind, Signal))
    signals = [kind for kind in SIGNALS.values() if issubclass(kind, wanted)]
    if bool in kinds:
        return bool(rng.integers(2))
    if signals:
        return drawn(signals[rng.integers(len(signals))], rng)
    if type(None) in kinds and (name in ("a", "a_rel") or rng.random() < 0.3):
        return None
    return float(rng.uniform(1.0, 2.0))


@pytest.mark.parametrize("kind", [*COMPONENTS, *SIGNALS.values()], ids=lambda kind: kind.__name__)
def test_every_parameter_of_every_component_comes_back(kind: type) -> None:
    rng = np.random.default_rng(len(kind.__name__))
    for _ in range(20):
        made = drawn(kind, rng)
        part = made if isinstance(made, Component) else Torque(made)
        text = tomli_w.dumps({"components": {"part": table_of(part)}})
        assert table_of(read_train(text)["part"]) == table_of(part)
