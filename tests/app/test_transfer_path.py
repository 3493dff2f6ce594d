"""The sound of a place, fitted to normal recordings whose microphone is known, from the command line to generation."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from app.cli import run
from app.simulated.generation import condition_of, fitted_microphones
from casebase.description import Labelling, RecordingDescription
from casebase.library import CaseLibrary
from signals.features import extract
from signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, Mode
from sim.acoustics.transfer_path_fit import NormalRecording, scenario_like
from sim.description.axis_document import write_axis
from sim.experiment.paper_axis import PAPER_AXIS

MODES = (Mode(110.0, 0.05, 1.0), Mode(420.0, 0.04, 0.7), Mode(1500.0, 0.03, 0.5))
MICROPHONE = Microphone(MODES, gain=5e-3, rubbing_n_m=4.0, ambient_n_m=0.5)


def _wav(samples: np.ndarray, path: Path) -> bytes:
    soundfile.write(path, samples, int(SAMPLE_RATE_HZ), subtype="PCM_16")
    return path.read_bytes()


def test_what_is_fitted_is_the_microphone_and_generation_uses_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    axis = tmp_path / "axis.toml"
    axis.write_text(write_axis(PAPER_AXIS))
    library = CaseLibrary.open(tmp_path)
    heard = NormalRecording(np.zeros(72_000, np.float32), 2.6, 38.0, 4.2)
    scenario = scenario_like(PAPER_AXIS, heard, MICROPHONE, 3)
    recording = Recording(scenario.perform(), SAMPLE_RATE_HZ)
    with library.transaction("test") as session:
        description = RecordingDescription(
            "n.wav", axis=PAPER_AXIS.name, gearbox="g1", condition=condition_of(scenario)
        )
        audio = _wav(recording.samples, tmp_path / "n.wav")
        extraction = extract(recording, condition_of(scenario))
        row = library.retain.recording(session, audio, recording, extraction, description)
        library.retain.case(session, row, Labelling("normal", origin="measured"))
    library.close()
    assert run(["--data-dir", str(tmp_path), "--json", "fit", "--axis", str(axis)]) == 0
    said = json.loads(capfd.readouterr().out)
    assert said["version"] == 1
    assert 0 <= said["test"]["told_apart"] <= 1
    assert said["misfit_db"]["g1"] < 2.0
    true = [mode.frequency_hz for mode in scenario.microphone.modes]
    found = [mode["frequency_hz"] for mode in said["microphones"][0]["modes"]]
    for frequency in true:
        assert min(abs(each / frequency - 1) for each in found) < 0.03
    library = CaseLibrary.open(tmp_path)
    microphones, version = fitted_microphones(library, PAPER_AXIS)
    library.close()
    assert version == 1
    assert [mode.frequency_hz for mode in microphones[0].modes] == pytest.approx(found)
