"""A log of two encoders without a torque is shown as what it is, on the page as over HTTP."""

from pathlib import Path

from benchmarks.encoder_logs import axis, log, strokes
from benchmarks.harness.inside import inside
from casebase.store.models import StoredInvestigation, now
from sim.investigation.investigate import investigate
from sim.investigation.report.summary import story


def test_the_page_of_two_encoders_speaks_of_no_model(tmp_path: Path) -> None:
    result = investigate(axis(), log(strokes([0.5, 1.0, 2.0]), gap=1e-3, runout=2e-3))
    document = {**result.document(), "story": story(result)}
    with inside(tmp_path) as service:
        with service.service.library.transaction("test") as session:
            row = StoredInvestigation(
                state="done", axis="bench", axis_document={}, document=document, report="", created_by="me", inputs={}
            )
            row.finished_at = now()
            session.add(row)
            session.flush()
            path = f"/investigations/{row.id}"
        answer = service.browse("GET", path)
        told = service.ask("GET", f"/api/v1{path}").json()
    assert answer.status_code == 200
    assert "Motor and load" in answer.text
    assert "Left: measurement and model" not in answer.text
    assert [f["mechanism"] for f in told["findings"]] == ["backlash", "eccentricity"]
