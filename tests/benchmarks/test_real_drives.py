"""Real drives from their logs as they are: no name is wrong, what is known to be there is named, sizes are near."""

import pytest

from benchmarks.real_drives.__main__ import Tally, of_truth
from benchmarks.real_drives.drives import Drive, drives
from sim.investigation.investigate import investigate
from tests.shared_data import shared

QUICK = ("ur10e J5 as logged", "screw 1 200 as logged", "screw 2 steady 100 as logged", "cogging steady_8s", "winch")


def one_of(drive: Drive) -> object:
    return pytest.param(drive, id=drive.name, marks=() if drive.name in QUICK else pytest.mark.slow)


@pytest.mark.parametrize("drive", [one_of(d) for d in drives() if not d.name.startswith("servo")])
def test_no_name_of_a_real_drive_is_wrong(drive: Drive) -> None:
    shared("data", *drive.log.split("/"))
    tally = Tally()
    result = investigate(drive.description(), drive.telemetry())
    wrong = of_truth(drive, result, tally)
    assert tally.right == tally.loud, wrong
    if drive.truth.silent:
        assert not [f for f in result.findings if f.probability > 0.5 and f.mechanism not in drive.truth.allowed], wrong
    for gain in result.gain:
        if gain.channel == "motor_torque_nm":
            assert gain.rms_after <= gain.rms_before
