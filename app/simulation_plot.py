"""A picture of one simulated run: what a technician would look at first."""

from pathlib import Path

import numpy as np

from casebase.signals.crest import crest_trace
from casebase.signals.filters import PAPER_CUTOFF_HZ, low_pass
from casebase.signals.spectra import long_spectrum
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.description.axis import Axis
from sim.experiment.virtual_measurement import Measurement

CYCLES = 3


def plot_measurement(result: Measurement, axis: Axis, out: Path) -> list[Path]:
    """Write run.png and run.svg: torque, speeds, force in the last mesh, sound, over the first three cycles."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 9), layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(4, 1, sharex=True)
    telemetry = result.telemetry
    shown = telemetry.time_s <= CYCLES * axis.motion.period_s
    time_s = telemetry.time_s[shown]
    rows[0].plot(time_s, telemetry["motor_torque_nm"][shown], lw=0.8)
    rows[0].set_ylabel("motor torque [N m]")
    rows[1].plot(time_s, telemetry["load_speed_rad_s"][shown], lw=0.8)
    rows[1].set_ylabel("load speed [rad/s]")
    if "shaft_torque_nm" in telemetry:
        rows[2].plot(time_s, telemetry["shaft_torque_nm"][shown], lw=0.8)
    rows[2].set_ylabel("torque on the load [N m]")
    low = low_pass(long_spectrum(result.sound, SAMPLE_RATE_HZ))
    time = np.arange(low.size) / SAMPLE_RATE_HZ
    heard = time <= CYCLES * axis.motion.period_s
    rows[3].plot(time[heard], low[heard], lw=0.5)
    rows[3].set_ylabel(f"sound below {PAPER_CUTOFF_HZ:g} Hz [1]")
    rows[3].set_xlabel("time [s]")
    crest = crest_trace(result.sound, SAMPLE_RATE_HZ).largest
    rows[3].set_title(f"crest factor of the whole record: {crest:.2f}", fontsize=9)
    effects = ", ".join(f"{entry.name} at {entry.location or 'the axis'}" for entry in axis.mechanisms)
    figure.suptitle(f"{axis.name}: {effects or 'no added mechanism'} (simulated)")
    for row in rows:
        row.grid(alpha=0.3)
    files = [out / "run.png", out / "run.svg"]
    for path in files:
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
    return files
