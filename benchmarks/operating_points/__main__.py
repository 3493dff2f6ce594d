"""Does a simulation of the axis carry cases to another operating point?

`python -m benchmarks.operating_points [--draws 4] [--first 1] [--telemetry] [--jobs 2]`. Every recording has a motion,
speed and payload of its own. The library has 5 or 10 gearboxes, four recordings each; queries are of 60 others. A fault
that adds less than a third to the sound it is in counts as normal. Each way of using the library answers the same
queries:

as they are: cases as they were recorded
simulated shift: each case moved by the difference of simulated means of its label, from its point to the query's
linear shift: moved along the operating point by a ridge regression of the library's features
calibrated shift: the simulated shift by 0, 1/2 or 1, and how sure an answer is, as the library's own gearboxes choose:
each is left out and its cases are answered by the others, moved to the point of that case
simulated alone: simulated cases at the query's point, and no measured one

`--real`: recordings of test stands at other loads and speeds instead, for which no axis is described.

Then what features can tell at all: a forest that was trained on the recordings of the other draws, each with its
operating point. Last, where the simulation errs: for the features that count most, how its means follow the recordings
over operating points, and by how much they lie too high.
"""

import argparse
import re
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import soundfile
from numpy.typing import NDArray
from sklearn.ensemble import RandomForestClassifier

from app.recordings.intake import condition_on
from app.simulated.generation import simulate_case
from benchmarks.diagnosis import DATA
from benchmarks.operating_points.gearboxes import AXIS, Fault, Label, OperatingPoint, Specimen
from benchmarks.operating_points.sound import record
from casebase.reasoning.classifier import Calibration, Classifier, log_odds
from casebase.reasoning.diagnosis import DIAGNOSED_FROM, Reasoner
from casebase.reasoning.novelty import RATIOS, comparable
from casebase.reasoning.priors import prior_weights
from casebase.search.case_table import CaseTable
from signals.errors import TelemetryError
from signals.features import EXTRACTOR_VERSION, NAMES, Extraction, extract
from signals.measured_motion import measured_motion
from signals.recording import Recording
from sim.description.axis import Motion
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import moved, plan

Floats = NDArray[np.float64]
Shift = Callable[["Library", Floats], Floats]
DESCRIBED = read_axis(AXIS)
LABELS: tuple[Label, ...] = ("normal", "play", "notch")
SPREAD, AUDIBLE, SIMULATED, ALONE = 0.35, 1 / 3, 100, 30
FEATURES = 6
PRIOR = 3.0  # simulated recordings that speak for no dependence on the operating point


@dataclass(frozen=True, eq=False)
class Recorded:
    """One recording: features as `comparable` returns them, its operating point, and what is true of it."""

    gearbox: str
    label: str
    truth: str
    point: Floats
    values: Floats
    extraction: Extraction


@dataclass(frozen=True, eq=False)
class Library:
    """Cases as arrays: features (cases, n), operating points (cases, 5), labels and gearboxes (cases,)."""

    values: Floats
    points: Floats
    labels: NDArray[np.str_]
    gearboxes: NDArray[np.str_]
    origin: str = "measured"

    @classmethod
    def of(cls, recordings: Sequence[Recorded]) -> "Library":
        return cls(
            np.array([each.values for each in recordings]),
            np.array([each.point for each in recordings]),
            np.array([each.label for each in recordings]),
            np.array([each.gearbox for each in recordings]),
        )

    def take(self, rows: NDArray[np.bool_]) -> "Library":
        return Library(self.values[rows], self.points[rows], self.labels[rows], self.gearboxes[rows], self.origin)

    def table(self, values: Floats) -> CaseTable:
        """Return the cases as if they had these features."""
        ids = np.array([f"{number:04d}" for number in range(len(values))])
        origins, axes = np.full(len(values), self.origin), np.full(len(values), DESCRIBED.name)
        names = (ids, self.labels, origins, axes, self.gearboxes, ids)
        return CaseTable(1, EXTRACTOR_VERSION, NAMES, *names, stored(values))

    def reasoner(self, values: Floats) -> Reasoner:
        return Reasoner(self.table(values))

    def classifier(self, values: Floats) -> Classifier:
        return Classifier(self.table(values), np.arange(len(values)))


def stored(values: Floats) -> NDArray[np.float32]:
    """Return features as a library stores them, from logarithms of ratios."""
    ratios = np.array([name.startswith(RATIOS) for name in NAMES])
    return np.where(ratios, np.exp(np.where(ratios, values, 0.0)), values).astype(np.float32)


def motion_of(point: OperatingPoint) -> Motion:
    """Return the simulator's motion of the same stroke: an s-curve by its ramp, a sine by its period as well."""
    speed, stroke = point.speed_rad_s, point.stroke_rad
    if point.kind == "sine":
        half = np.pi * stroke / 2 / speed
        ramp = min(0.999 * half / 2, 0.8 * stroke / speed)
        return Motion(2 * half, stroke / (half - ramp), ramp, 0.0)
    slower = min(1.0, float(np.sqrt(stroke / (speed * point.accel_s))))
    way_s = stroke / (speed * slower) + point.accel_s * slower
    return Motion(
        2 * (way_s + point.dwell_s), speed * slower, min(point.accel_s * slower, 0.499 * way_s), point.dwell_s
    )


def coordinates(point: OperatingPoint) -> Floats:
    """Return the operating point as logarithms over a usual one, and the dwell: shape (5,)."""
    motion = motion_of(point)
    way = np.array([motion.load_speed_rad_s / 2.5, motion.acceleration_time_s / 0.35, point.payload_kg_m2 / 36])
    return np.array([*np.log(way), np.log(point.stroke_rad / 7), (motion.dwell_s - 0.12) / 0.1])


def drawn(rng: np.random.Generator) -> OperatingPoint:
    """Draw an operating point as every recording has one of its own."""
    return OperatingPoint.draw(rng, ("trapezoid", "s_curve", "sine")[rng.integers(3)], SPREAD)


def recorded(task: tuple[int, Label, int], with_telemetry: bool = False) -> Recorded:
    """Record a gearbox with a label at a point drawn by the seed, and take features as the service does."""
    gearbox, label, seed = task
    rng = np.random.default_rng([seed, 17])
    point = drawn(rng)
    fault = None if label == "normal" else Fault.draw(rng, label)
    made = record(Specimen.draw(gearbox), fault, point, seed, with_telemetry=with_telemetry)
    condition = condition_on(DESCRIBED, motion_of(point).load_speed_rad_s, point.payload_kg_m2)
    if made.telemetry is not None:
        with suppress(TelemetryError):  # less than one way from end to end
            motion = measured_motion(made.telemetry.time_s, made.telemetry.load_angle_rad)
            condition = replace(condition, **motion.condition(0.0, 20.0))
    extraction = extract(Recording(made.samples.astype(np.float32), float(made.rate)), condition)
    truth = label if label == "normal" or made.audible >= AUDIBLE else "normal"
    values = comparable(NAMES, extraction.features.values)
    return Recorded(str(gearbox), label, truth, coordinates(point), values, extraction)


def simulated(task: tuple[Label, int]) -> tuple[Floats, Floats]:
    """Simulate a case at a point of its own: its point and its features."""
    label, number = task
    point = drawn(np.random.default_rng([number, LABELS.index(label), 77]))
    motion = motion_of(point)
    (planned,) = plan(replace(DESCRIBED, motion=motion), {label: SIMULATED}, seed=11, only=range(number, number + 1))
    case = simulate_case(moved(planned, motion, point.payload_kg_m2))
    return coordinates(point), comparable(NAMES, case.extraction.features.values)


class Emulator:
    """Means and residuals of simulated features by label: a ridge regression, quadratic in the operating point.

    Source: O'Hagan, Bayesian analysis of computer code outputs, Reliability Engineering and System Safety 91 (2006).
    """

    def __init__(self, points: dict[str, Floats], values: dict[str, Floats]) -> None:
        self._weights: dict[str, Floats] = {}
        self.residuals: dict[str, Floats] = {}
        for label, own in values.items():
            table = _quadratic(points[label])
            known = np.isfinite(own)
            penalty = PRIOR * np.diag(np.r_[1e-6, np.ones(table.shape[1] - 1)])
            columns = [
                np.linalg.solve(table[row].T @ table[row] + penalty, table[row].T @ each[row])
                for each, row in zip(own.T, known.T, strict=True)
            ]
            self._weights[label] = np.array(columns).T
            self.residuals[label] = own - table @ self._weights[label]

    def mean(self, labels: Sequence[str], points: Floats) -> Floats:
        """Return the expected features of labels at points, shape (cases, n)."""
        return np.array(
            [_quadratic(at[None])[0] @ self._weights[each] for each, at in zip(labels, points, strict=True)]
        )


def _quadratic(points: Floats) -> Floats:
    first, second = np.triu_indices(points.shape[1])
    return np.concatenate([np.ones((len(points), 1)), points, points[:, first] * points[:, second]], axis=1)


def _within(labels: NDArray[np.str_], values: Floats) -> Floats:
    """Return what values differ by from the mean of their label."""
    centred = values.copy()
    for label in np.unique(labels):
        centred[labels == label] -= np.nanmean(values[labels == label], axis=0)
    return np.nan_to_num(centred)


def linear_shift(library: Library, point: Floats) -> Floats:
    """Return what cases are moved by along the operating point."""
    table, seen = _within(library.labels, library.points), _within(library.labels, library.values)
    slopes = np.linalg.solve(table.T @ table + np.eye(table.shape[1]), table.T @ seen)
    return np.asarray((point - library.points) @ slopes)


def shifts(emulator: Emulator) -> dict[str, Shift]:
    """Return each way of moving the cases of a library to an operating point, shape (5,)."""

    def simulated_shift(library: Library, point: Floats) -> Floats:
        there = emulator.mean(list(library.labels), np.repeat(point[None], len(library.points), axis=0))
        return there - emulator.mean(list(library.labels), library.points)

    return {
        "as they are": lambda library, _: np.zeros_like(library.values),
        "simulated shift": simulated_shift,
        "linear shift": linear_shift,
    }


def calibrated(library: Library, shift: Shift) -> tuple[float, Calibration]:
    """Return by how much of the shift cases of a gearbox left out are most probable, and how often answers are right.

    Each is answered by the others at its own point: were all moved to one point first, the shift would tell its label.
    """
    found = []
    for factor in (0.0, 0.5, 1.0):
        scores, right, loss = [], [], 0.0
        for index, (label, box) in enumerate(zip(library.labels, library.gearboxes, strict=True)):
            others = library.take(library.gearboxes != box)
            there = others.values + factor * shift(others, library.points[index])
            classifier = others.classifier(there)
            shares = classifier.shares(stored(library.values[index]))
            scores.append(float(log_odds(shares.max())))
            right.append(classifier.classes[int(shares.argmax())] == label)
            loss -= float(np.log(max(shares[classifier.classes.index(label)], 1e-4)))
        found.append((loss, factor, Calibration.of(np.array(scores), np.array(right))))
    _, factor, calibration = min(found, key=lambda each: each[0])
    return factor, calibration


def recalibrated(reasoner: Reasoner, calibration: Calibration, query: Recorded) -> tuple[str, str | None]:
    """Return the leading label, and the one that is diagnosed with another calibration of how sure that is."""
    model = reasoner.model(DESCRIBED.name)
    assert model.classifier is not None
    shares = model.classifier.shares(query.extraction.features.values)
    leading = model.classifier.classes[int(shares.argmax())]
    judgement = reasoner.judge(query.extraction.features.values, DESCRIBED.name)
    sure = calibration.probability(float(log_odds(shares.max()))) >= DIAGNOSED_FROM
    usual = judgement.p_value is not None and not judgement.novel
    return leading, leading if sure and usual and not query.extraction.poor else None


def answered(reasoner: Reasoner, query: Recorded) -> tuple[str, str | None]:
    """Return the leading label, and the one that is diagnosed."""
    found = reasoner.diagnose(query.extraction, axis=DESCRIBED.name, gearbox=query.gearbox)
    leading = found.hypotheses[0].label if found.hypotheses else ""
    return leading, found.label if found.verdict == "diagnosed" else None


def line(name: str, queries: Sequence[Recorded], answers: Sequence[tuple[str, str | None]]) -> str:
    """Return a line of the table: shares of known labels, and how many unknown faults are called normal."""
    known = [(query.truth, *answer) for query, answer in zip(queries, answers, strict=True) if query.truth in LABELS]
    unknown = [said for query, (_, said) in zip(queries, answers, strict=True) if query.truth not in LABELS]
    leads = np.mean([truth == leading for truth, leading, _ in known])
    right = np.mean([truth == said for truth, _, said in known])
    wrong = np.mean([said not in (None, truth) for truth, _, said in known])
    rest = f"{unknown.count('normal')} of {len(unknown)}"
    return f"{name:16} leads {leads:.2f}  said {right:.2f}  wrong {wrong:.3f}  unknown fault called normal {rest}"


def tasks_of(draw: int) -> tuple[list[tuple[int, Label, int]], list[tuple[int, Label, int]]]:
    """Return what is recorded of ten gearboxes for the library, and of sixty others as queries."""
    kinds: tuple[Label, ...] = ("normal", "normal", "play", "notch")
    library = [
        (1000 * draw + box, label, 100_000 * draw + 10 * box + number)
        for box in range(10)
        for number, label in enumerate(kinds)
    ]
    queries: list[tuple[int, Label, int]] = []
    for box in range(60):
        labels: list[Label] = ["play", "notch"] if box % 2 else ["normal", "play", "notch"]
        labels += [("bearing", "rub")[box // 3 % 2]] if box % 3 == 0 else []
        queries += [
            (1000 * draw + 100 + box, each, 100_000 * draw + 5000 + 10 * box + k) for k, each in enumerate(labels)
        ]
    return library, queries


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--telemetry", action="store_true", help="the motion is measured")
    parser.add_argument("--real", action="store_true")
    asked = parser.parse_args()
    if asked.real:
        print("\n".join(measured()))
        return
    with ProcessPoolExecutor(asked.jobs) as pool:
        made = [
            tuple(
                list(pool.map(partial(recorded, with_telemetry=asked.telemetry), part, chunksize=4))
                for part in tasks_of(draw)
            )
            for draw in range(asked.first, asked.first + asked.draws)
        ]
        cases = {
            label: list(pool.map(simulated, [(label, number) for number in range(SIMULATED)], chunksize=4))
            for label in LABELS
        }
    emulator = Emulator(
        {str(label): np.array([at for at, _ in own]) for label, own in cases.items()},
        {str(label): np.array([values for _, values in own]) for label, own in cases.items()},
    )
    ways = shifts(emulator)
    asked_all = [query for _, queries in made for query in queries]
    alone = [answered(_simulated_at(emulator, query.point), query) for query in asked_all]
    for gearboxes in (5, 10):
        print(f"library of {gearboxes} gearboxes")
        answers: dict[str, list[tuple[str, str | None]]] = {name: [] for name in (*ways, "calibrated shift")}
        for cases_of, queries in made:
            library = Library.of([each for each in cases_of if int(each.gearbox) % 1000 < gearboxes])
            still = library.reasoner(library.values)
            factor, calibration = calibrated(library, ways["simulated shift"])
            for query in queries:
                for name, shift in ways.items():
                    reasoner = still
                    if name != "as they are":
                        reasoner = library.reasoner(library.values + shift(library, query.point))
                    answers[name].append(answered(reasoner, query))
                moved_cases = library.values + factor * ways["simulated shift"](library, query.point)
                answers["calibrated shift"].append(recalibrated(library.reasoner(moved_cases), calibration, query))
        for name, own in [*answers.items(), ("simulated alone", alone)]:
            print(line(name, asked_all, own), flush=True)
    everything = [each for pair in made for part in pair for each in part]
    print(f"a forest of the other draws: leads {_ceiling([[*library, *queries] for library, queries in made]):.2f}")
    print("\n".join(_errors(emulator, [each for each in everything if each.label == each.truth])))


def measured() -> list[str]:
    """Return lines of gears at loads to 20 % as cases and above as queries, and of motors to 1,700 rpm and above.

    Each sensor of the gears is a library of its own. One assembly is good and one damaged: this tells assemblies apart.
    """
    lines = []
    for folder, parts, border in (("spectraquest", r"(\w+)_()load(\d+)", 25.0), ("bldc", r"(\w+)_(M\d)_(\d+)", 1700.0)):
        sounds: dict[int, list[tuple[bool, Recorded]]] = {}
        for path in sorted((DATA / folder).iterdir()):
            if found := re.fullmatch(parts, path.stem):
                samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
                label, value = "normal" if found[1] == "healthy" else "notch", float(found[3])
                for sensor, each in enumerate(samples.T):
                    taken = extract(Recording(each.copy(), float(rate)))
                    values, point = comparable(NAMES, taken.features.values), np.array([value / border])
                    one = Recorded(path.stem, label, label, point, values, taken)
                    sounds.setdefault(sensor, []).append((value > border, one))
        for name in ("as they are", "linear shift"):
            answers = []
            for own in sounds.values():
                library = Library.of([one for is_asked, one in own if not is_asked])
                for query in (one for is_asked, one in own if is_asked):
                    shift = linear_shift(library, query.point) if name == "linear shift" else 0.0
                    answers.append((query, answered(library.reasoner(library.values + shift), query)))
            lines.append(f"{folder:13} {line(name, *zip(*answers, strict=True))}")
    return lines


def _errors(emulator: Emulator, recordings: Sequence[Recorded]) -> list[str]:
    """Return lines that hold simulated means against recordings whose label can be heard."""
    lines = []
    for index in np.argsort(-prior_weights(NAMES), kind="stable")[:FEATURES]:
        for label in LABELS:
            own = [each for each in recordings if each.label == label and np.isfinite(each.values[index])]
            seen = np.array([each.values[index] for each in own])
            mean = emulator.mean([label] * len(own), np.array([each.point for each in own]))[:, index]
            spread = f"scatter {seen.std():.1f}, of the means {mean.std():.1f}"
            follows = f"correlation {np.corrcoef(seen, mean)[0, 1]:+.2f}"
            lines.append(f"{NAMES[index]:30} {label:7} {follows}  too high by {(mean - seen).mean():+.1f}  {spread}")
    return lines


def _simulated_at(emulator: Emulator, point: Floats) -> Reasoner:
    labels = np.repeat(LABELS, ALONE)
    scatter = np.concatenate([emulator.residuals[label][:ALONE] for label in LABELS])
    values = emulator.mean(list(labels), np.repeat(point[None], len(labels), axis=0)) + scatter
    boxes = np.array([f"s{number}" for number in range(len(labels))])
    return Library(values, np.repeat(point[None], len(labels), axis=0), labels, boxes, "simulated").reasoner(values)


def _ceiling(draws: Sequence[Sequence[Recorded]]) -> float:
    def table(recordings: Sequence[Recorded]) -> tuple[Floats, list[str]]:
        own = [each for each in recordings if each.label in LABELS]
        values = np.nan_to_num([[*each.values, *each.point] for each in own])
        return np.asarray(values), [each.truth for each in own]

    right: list[bool] = []
    for number, asked in enumerate(draws):
        others = [each for other, draw in enumerate(draws) if other != number for each in draw]
        if others:
            forest = RandomForestClassifier(500, class_weight="balanced", random_state=0).fit(*table(others))
            values, truth = table(asked)
            right += list(forest.predict(values) == np.array(truth))
    return float(np.mean(right)) if right else float("nan")


if __name__ == "__main__":
    main()
