"""A few hidden effects through the command line in every test run; the full bank is `make challenge`."""

from __future__ import annotations

import pytest

from tests.hidden_effects.bank import QUICK_BANK, Entry
from tests.hidden_effects.product import has_investigate, investigate
from tests.hidden_effects.scoring import judge

RECORDING_S = 20.0


@pytest.mark.slow
@pytest.mark.parametrize("entry", QUICK_BANK, ids=lambda e: f"{e.group}-{'+'.join(e.effects)}-{e.seed}")
def test_what_was_hidden_is_found_with_its_place_and_size_and_nothing_else(entry: Entry) -> None:
    if not has_investigate():
        pytest.skip("the command line has no verb `investigate`")
    scenario = entry.scenario(RECORDING_S)
    said = investigate(scenario)
    assert said.document is not None, said.failure
    judgement = judge(scenario.answer(), said.document)
    found = [(f["mechanism"], f.get("location"), f["probability"]) for f in said.document["findings"]]
    assert judgement.solved, f"hidden {scenario.hidden}, said {said.document['verdict']} {found}"
    off = [check for check in judgement.sizes if not check.within]
    assert not off, f"hidden {scenario.hidden}, sizes off: {off}"
