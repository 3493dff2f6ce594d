"""Figures 2 and 3 of the paper, the gear and its model: `python -m benchmarks.paper_diagrams docs/figures`.

Both are drawn from the objects that are simulated: the wheels from the tooth numbers of `sim.experiment.paper_axis`
(at one module, so radii go with teeth), their speeds from the run of figure 4, the model from the components and
connections of its drive train.
"""

from __future__ import annotations

import math
import sys
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.paper_torque import RATE_HZ, SECONDS, TRAIN
from sim import simulate
from sim.experiment.paper_axis import PAPER_AXIS
from sim.rotational.component import Component

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def wheels() -> list[tuple[str, float, float, float]]:
    """Name, place [teeth], radius [teeth] and largest speed in the run of figure 4 [rad/s] of every wheel.

    Motor side first; wheels of a mesh touch.
    """
    drawn, centre = [], 0.0
    driver, speed = "pinion on the motor shaft", float(np.abs(simulate(TRAIN, SECONDS, RATE_HZ)["motor.w"]).max())
    for stage in PAPER_AXIS.stages:
        assert stage.driver_teeth is not None
        assert stage.driven_teeth is not None
        drawn.append((f"{driver}, {stage.driver_teeth} teeth", centre, stage.driver_teeth / 2, speed))
        centre += (stage.driver_teeth + stage.driven_teeth) / 2
        speed *= stage.driver_teeth / stage.driven_teeth
        drawn.append((f"{stage.name} gear, {stage.driven_teeth} teeth", centre, stage.driven_teeth / 2, speed))
        driver = f"pinion on the {stage.name} shaft"
    return drawn


def words(name: str, component: Component) -> str:
    """Name, class and the numbers that differ from the defaults."""
    numbers = []
    for each in fields(component):  # type: ignore[arg-type]
        value = getattr(component, each.name)
        if each.default is MISSING or value != each.default:
            numbers.append(f"{each.name} = {value}")
    return "\n".join([f"{name}: {type(component).__name__}", *numbers])


def draw_gear(axes: Axes) -> None:
    """Figure 2: the wheels, where play and notch sit, where the microphone is."""
    from matplotlib.patches import Circle

    for number, (name, at, radius, speed) in enumerate(wheels()):
        axes.add_patch(Circle((at, 0), radius, fill=False, lw=1.2, color=f"C{number}"))
        axes.plot(at, 0, ".", color=f"C{number}")
        low = (
            {} if number % 2 else {"xytext": (at - 25, -70 - 8 * number), "arrowprops": {"arrowstyle": "-", "lw": 0.5}}
        )
        place = low or {"xytext": (at, radius + 4), "ha": "center"}
        axes.annotate(f"{name}, {speed:.2g} rad/s", (at, -radius if low else radius), fontsize=8, **place)
    notch = (at + radius * math.cos(0.9), radius * math.sin(0.9))
    arrow = {"arrowstyle": "->"}
    axes.annotate("notch: one flank of one tooth", notch, xytext=(at + 95, 60), fontsize=8, arrowprops=arrow)
    axes.annotate("play", (at - radius, 0), xytext=(at - radius - 66, 70), fontsize=8, arrowprops=arrow)
    axes.annotate("microphone at the housing", (at + 95, -50), fontsize=8)
    axes.set(
        xlim=(-30, at + 190),
        ylim=(-100, 95),
        aspect="equal",
        title="2: the gear of the axis, with the largest speeds of figure 4",
    )
    axes.axis("off")


def draw_model(axes: Axes) -> None:
    """Figure 3: components in series, one line per connection."""
    places = {name: (index, 0.0) for index, name in enumerate(TRAIN.components)}
    for name, component in TRAIN.components.items():
        text = words(name, component).replace(", ", ",\n")
        axes.text(
            *places[name],
            text,
            ha="center",
            va="center",
            fontsize=6.5,
            bbox={"boxstyle": "round", "fc": "1", "ec": "C0"},
        )
    for flanges in TRAIN.connections:
        ends = [places[next(name for name in places if flange.startswith(f"{name}."))] for flange in flanges]
        axes.plot(*zip(*ends, strict=True), "k-", lw=1, zorder=0)
    axes.set(
        xlim=(-0.6, len(places) - 0.4), ylim=(-1, 1), title="3: the paper's model, as it is simulated for figure 4"
    )
    axes.axis("off")


def main(out: Path) -> None:
    """Write paper_2_and_3.png."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    out.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(9, 6.5), layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, height_ratios=(2, 1))
    draw_gear(upper)
    draw_model(lower)
    path = out / "paper_2_and_3.png"
    figure.savefig(path, dpi=80)
    print(path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
