"""Seconds of the campaign; `make bombs` is its long form."""

from pathlib import Path

from benchmarks.bombs.campaign import Campaign
from benchmarks.bombs.inputs import AXIS_BOMBS, Inputs
from benchmarks.harness.live import started

OPENED = 20_000_000 * 2 * 8
"""Bytes to which the Parquet file opens that is sent."""


def test_wrong_inputs_are_refused_in_words_and_cost_nobody_else(tmp_path: Path) -> None:
    server = started(tmp_path / "data")
    campaign = Campaign(server, Inputs(1), batch=4)
    del campaign.inputs.kinds["sound"]  # tests.signals has more of those
    try:
        campaign.run(len(campaign.inputs.kinds) * campaign.batch)
    finally:
        server.stop()
    tally = campaign.tally
    assert tally.faults == []
    assert sum(count for (kind, _), count in tally.answers.items() if kind == "bomb") > len(AXIS_BOMBS)
    assert all(400 <= status < 500 for kind, status in tally.answers if kind == "bomb")
    assert len(tally.live_s) > 10
    assert tally.grown_bytes < OPENED
