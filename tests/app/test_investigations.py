"""Investigations over HTTP without a worker: their state is their job's, the report comes as asked for."""

import csv
import io
import math
from hashlib import sha256

import httpx
import numpy as np
import pytest

from app.investigations import accept, get_investigation, names_of, perform
from benchmarks.harness.live import LiveServer
from benchmarks.harness.sounds import sound
from benchmarks.harness.telemetry_of import one_body
from casebase.axes import get_axis
from casebase.errors import ConflictError
from casebase.library import CaseLibrary
from casebase.store.models import StoredInvestigation, now

URL = "/api/v1/investigations"
AXIS = '{"name": "asked", "motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 1.0}}'
DOCUMENT = {
    "verdict": "nothing_missing",
    **{name: [] for name in ("findings", "parameters", "gain", "remarks", "rejected")},
    "extended_axis": {},
    "provenance": {},
    "unexplained": None,
    "next_measurement": "",
    "story": {"headline": "Nothing was found."},
}

BACKLASH = {
    "mechanism": "backlash",
    "location": "output",
    "probability": 0.95,
    "parameters": [],
    "indistinguishable_from": [],
    "explanation": "",
}


def telemetry(size: float = 1.0) -> bytes:
    """Return two seconds of a motor that swings; `size`: of its torque [N m]."""
    out = io.StringIO()
    table = csv.writer(out)
    table.writerow(("time_s", "motor_torque_nm", "motor_speed_rad_s"))
    table.writerows((number / 1000, size * math.cos(number / 100), math.sin(number / 100)) for number in range(2000))
    return out.getvalue().encode()


def test_an_unfinished_investigation_is_what_its_job_is(operator: httpx.Client) -> None:
    files = {"telemetry": ("t.csv", telemetry(), "text/csv")}
    asked = operator.post(URL, files=files, data={"axis": AXIS}).raise_for_status().json()
    url = f"{URL}/{asked['investigation_id']}"

    def said() -> list[str]:
        listed = operator.get(URL, params={"limit": 1}).json()["items"][0]
        assert listed["id"] == asked["investigation_id"]
        answers = [operator.get(url), operator.get(f"{url}/report")]
        assert [answer.status_code for answer in answers] == [409, 409]
        return [listed["state"], *(answer.json()["detail"].split(" is ")[1].split(";")[0] for answer in answers)]

    assert said() == ["queued"] * 3
    operator.delete(f"/api/v1/jobs/{asked['id']}").raise_for_status()
    assert said() == ["cancelled"] * 3


def test_a_log_with_other_columns_is_taken_with_its_map_and_refused_without(operator: httpx.Client) -> None:
    log = telemetry().replace(b"time_s", b"t", 1).replace(b"motor_torque_nm", b"i_q", 1)
    files = {"telemetry": ("t.csv", log, "text/csv")}
    text = """
        [time_s]
        column = "t"
        [motor_torque_nm]
        column = "i_q"
        unit = "A"
        factor = 0.05
        [motor_speed_rad_s]
        column = 3
    """
    refused = operator.post(URL, files=files, data={"axis": AXIS})
    assert (refused.status_code, "time_s has no unit" in refused.json()["detail"]) == (422, True)
    wrong = operator.post(URL, files=files, data={"axis": AXIS, "channels": text.replace("factor = 0.05", "")})
    assert (wrong.status_code, "[motor_torque_nm] unit = 'A' needs factor" in wrong.json()["detail"]) == (422, True)
    alone = operator.post(URL, files={"sound": ("a.wav", sound(3), "audio/wav")}, data={"axis": AXIS, "channels": text})
    assert (alone.status_code, "there is none" in alone.json()["detail"]) == (422, True)
    asked = operator.post(URL, files=files, data={"axis": AXIS, "channels": text}).raise_for_status().json()
    operator.delete(f"/api/v1/jobs/{asked['id']}").raise_for_status()


def test_the_report_comes_as_it_is_asked_for(live_server: LiveServer, viewer: httpx.Client) -> None:
    library = CaseLibrary.open(live_server.data_dir)
    row = StoredInvestigation(
        state="done", axis="told", axis_document={}, inputs={}, document=DOCUMENT, report="<p>told</p>", created_by="me"
    )
    with library.transaction("test") as session:
        row.finished_at = now()
        session.add(row)
        session.flush()
        url = f"{URL}/{row.id}/report"
    library.close()
    page, document = viewer.get(url), viewer.get(url, headers={"Accept": "application/json"})
    assert (page.headers["content-type"], page.text) == ("text/html; charset=utf-8", "<p>told</p>")
    assert DOCUMENT.items() <= document.json().items()
    assert {page.headers["vary"], document.headers["vary"]} == {"Accept"}
    assert viewer.get(url, headers={"Accept": "application/pdf"}).status_code == 406


def test_several_sounds_are_kept_and_none_beside_telemetry(operator: httpx.Client, live_server: LiveServer) -> None:
    """Recordings of one axis belong together; beside telemetry only one can start with it."""
    sounds = [("sound", (f"{seed}.wav", sound(seed), "audio/wav")) for seed in (1, 2, 1)]
    asked = operator.post(URL, files=sounds, data={"axis": AXIS}).raise_for_status().json()
    library = CaseLibrary.open(live_server.data_dir)
    with library.reading() as session:
        kept = get_investigation(session, asked["investigation_id"]).inputs["sound"]
    library.close()
    assert [one["name"] for one in kept] == ["1.wav", "2.wav", "1.wav"]
    assert len({one["sha256"] for one in kept}) == 2
    refused = operator.post(URL, files=[*sounds, ("telemetry", ("t.csv", telemetry()))], data={"axis": AXIS})
    assert refused.status_code == 422
    assert "3 sounds beside one telemetry" in refused.json()["detail"]
    twice = [("telemetry", ("t.csv", telemetry())) for _ in range(2)]
    assert "twice" in operator.post(URL, files=twice, data={"axis": AXIS}).json()["detail"]


@pytest.mark.parametrize("verdict", ["named", "nothing_missing", "unnamed"])
def test_only_what_is_named_extends_an_axis_and_its_description_stays(live_server: LiveServer, verdict: str) -> None:
    """The first revision of an axis that is new here is what was described, the second what was found."""
    library = CaseLibrary.open(live_server.data_dir)
    described = {"name": f"of-{verdict}", "motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 1.0}}
    extended = described | {"motor": {"inertia_kg_m2": 0.006, "coulomb_friction_n_m": 0.4}}
    with library.transaction("test") as session:
        row = StoredInvestigation(
            state="done", axis=str(described["name"]), axis_document=described, inputs={}, created_by="me",
            document={**DOCUMENT, "verdict": verdict, "extended_axis": extended},
        )  # fmt: skip
        session.add(row)
        session.flush()
        if verdict != "named":
            with pytest.raises(ConflictError, match="names nothing"):
                accept(library, session, row)
        else:
            assert accept(library, session, row).revision == accept(library, session, row).revision == 2
            first, second = (get_axis(session, str(described["name"]), k).document for k in (1, 2))
            assert (first["motor"], second["motor"]) == (described["motor"], extended["motor"])
    library.close()


def test_sound_is_compared_with_sound_as_new(operator: httpx.Client, live_server: LiveServer) -> None:
    files = [("sound", ("today.wav", sound(1)))]
    files += [("as_new", (f"{month}.wav", sound(seed))) for month, seed in (("may", 2), ("june", 3))]
    asked = operator.post(URL, files=files, data={"axis": AXIS}).raise_for_status().json()
    library = CaseLibrary.open(live_server.data_dir)
    with library.reading() as session:
        row = get_investigation(session, asked["investigation_id"])
    assert (names_of(row, "sound"), names_of(row, "as_new")) == (["today.wav"], ["may.wav", "june.wav"])
    perform(library, row.id, lambda stage, share: None)
    document = operator.get(f"{URL}/{row.id}").raise_for_status().json()
    assert document["provenance"]["as_new_sha256"].count("+") == 1
    assert "when the axis was new was given" not in str(document["not_examined"])
    assert "may.wav" in operator.get(f"{URL}/{row.id}/report", headers={"Accept": "text/html"}).text


def test_a_diagnosis_brings_its_recording_and_its_axis(
    operator: httpx.Client, admin: httpx.Client, live_server: LiveServer
) -> None:
    """The sound is what was diagnosed, its channel included; both lead to each other."""
    described = {"name": "heard axis", "motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 1.0}}
    admin.post("/api/v1/axes", json=described).raise_for_status()
    files = {"file": ("a.wav", sound(21)), "metadata": (None, '{"axis": "heard axis"}')}
    diagnosed = operator.post("/api/v1/diagnoses", files=files).raise_for_status().json()
    given = {"diagnosis": (None, diagnosed["id"])}
    asked = operator.post(URL, files=given).raise_for_status().json()
    identity = asked["investigation_id"]
    library = CaseLibrary.open(live_server.data_dir)
    with library.reading() as session:
        inputs = get_investigation(session, identity).inputs
    kept = {"name": "a.wav", "sha256": sha256(sound(21)).hexdigest(), "suffix": ".wav", "channel": 0}
    assert inputs["sound"] == [kept]
    perform(library, identity, lambda stage, share: None)
    library.close()
    listed = operator.get(URL, params={"limit": 1}).json()["items"][0]
    assert (listed["diagnosis_id"], listed["axis"]) == (diagnosed["id"], "heard axis")
    cookies = live_server.session("viewer")
    here, there = f"/diagnoses/{diagnosed['id']}", f"/investigations/{identity}"
    for page, other in ((here, there), (there, here)):
        text = httpx.get(f"{live_server.url}{page}", cookies=cookies).raise_for_status().text
        assert f'href="{other}"' in text
    both = operator.post(URL, files={**given, "sound": ("b.wav", sound(22))})
    assert (both.status_code, "do not go together" in both.json()["detail"]) == (422, True)
    admin.delete(f"/api/v1/recordings/{diagnosed['recording']['id']}").raise_for_status()
    gone = operator.post(URL, files={**given, "sound_offset_s": (None, "1.0")})
    assert (gone.status_code, "was erased" in gone.json()["detail"]) == (422, True)


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ({"telemetry": telemetry(), "sound": sound(1), "as_new": sound(2)}, "without telemetry"),
        ({"as_new": sound(2)}, "nothing to investigate"),
        ({"sound": sound(1), "as_new": sound(1)}, "given as sound as well"),
        ({"sound": sound(1), "as_new": b"no sound"}, "as_new.wav"),
    ],
)
def test_what_cannot_be_compared_is_refused(operator: httpx.Client, parts: dict[str, bytes], told: str) -> None:
    files = [(name, (f"{name}.wav", content)) for name, content in parts.items()]
    refused = operator.post(URL, files=files, data={"axis": AXIS})
    assert 400 <= refused.status_code < 500
    assert told in refused.json()["detail"]


def test_telemetries_that_do_not_fit_are_refused_by_name(operator: httpx.Client) -> None:
    good = ("telemetry", ("good.csv", telemetry()))
    for wrong, said in [
        ([("telemetry", ("again.csv", telemetry()))], "again.csv is the same file as good.csv"),
        (
            [("telemetry", ("text.csv", b"nothing\n1\n"))],
            "text.csv: the names and units of the columns do not tell enough",
        ),
        ([("telemetry", ("b.csv", telemetry(2.0))), *[("sound", ("s.wav", sound(1)))] * 3], "3 sounds beside 2 telem"),
    ]:
        refused = operator.post(URL, files=[good, *wrong], data={"axis": AXIS})
        assert refused.status_code == 422
        assert said in refused.json()["detail"]


@pytest.mark.parametrize("part", ["as_new", "telemetry"])
def test_a_refused_investigation_leaves_no_file(operator: httpx.Client, live_server: LiveServer, part: str) -> None:
    there = sorted((live_server.data_dir / "audio").rglob("*"))
    content = telemetry(7.0) if part == "telemetry" else sound(77)
    names = (part, "sound" if part == "as_new" else part)
    refused = operator.post(URL, files=[(name, ("same", content)) for name in names], data={"axis": AXIS})
    assert refused.status_code == 422
    assert sorted((live_server.data_dir / "audio").rglob("*")) == there


def measured(seed: int) -> bytes:
    """Return six seconds of one body with friction."""
    recording = one_body(0.3, 1.0, 0.02, seed)
    out = io.StringIO()
    table = csv.writer(out)
    table.writerow(("time_s", *recording.channels))
    rows = np.column_stack([recording.time_s, *recording.channels.values()])[:6000]
    table.writerows(rows.tolist())
    return out.getvalue().encode()


def test_several_telemetries_become_one_document_and_one_report(
    operator: httpx.Client, viewer: httpx.Client, admin: httpx.Client, live_server: LiveServer
) -> None:
    axis = '{"name": "joined", "motor": {"inertia_kg_m2": 0.3}, "load": {"inertia_kg_m2": 0.0}}'
    files = [("telemetry", (f"{name}.csv", measured(seed))) for name, seed in (("monday", 1), ("friday", 2))]
    identity = operator.post(URL, files=files, data={"axis": axis}).raise_for_status().json()["investigation_id"]
    stages: list[str] = []
    library = CaseLibrary.open(live_server.data_dir)
    perform(library, identity, lambda stage, _: stages.append(stage))
    library.close()
    assert "recording 2 of 2: candidates, round 1" in stages
    document = viewer.get(f"{URL}/{identity}").raise_for_status().json()
    assert [one["name"] for one in document["recordings"]] == ["monday.csv", "friday.csv"]
    assert {f["mechanism"] for f in document["findings"]} == {"coulomb_friction", "viscous_friction"}
    page = viewer.get(f"{URL}/{identity}/report", headers={"Accept": "text/html"}).text
    assert page.count('<details id="recording-') == 2
    cookies = live_server.session("viewer")
    shown = httpx.get(f"{live_server.url}/investigations/{identity}", cookies=cookies).raise_for_status().text
    listed = shown.index("<h2>Recordings</h2>")
    assert listed < shown.index("monday.csv", listed) < shown.index("friday.csv", listed)
    assert "torque over speed, in " in shown  # one plot of each, of the recording that shows it most surely
    stored = admin.post(f"{URL}/{identity}/accept").raise_for_status().json()
    friction = stored["document"]["motor"]["coulomb_friction_n_m"]
    assert friction == document["extended_axis"]["motor"]["coulomb_friction_n_m"]
    assert friction == pytest.approx(1.0, rel=0.05)


def test_two_of_one_axis_are_compared_and_those_of_two_axes_refused(
    viewer: httpx.Client, live_server: LiveServer
) -> None:
    """The earlier stands first, whichever is asked for."""
    library = CaseLibrary.open(live_server.data_dir)
    ids = {}
    with library.transaction("test") as session:
        for name, axis, findings in (
            ("earlier", "twice", []),
            ("later", "twice", [BACKLASH]),
            ("other", "once", []),
        ):
            document = {**DOCUMENT, "verdict": "named" if findings else "nothing_missing", "findings": findings}
            row = StoredInvestigation(
                state="done", axis=axis, axis_document={}, inputs={}, document=document, created_by="me"
            )
            session.add(row)
            session.flush()
            ids[name] = row.id
    library.close()
    for first, second in (("earlier", "later"), ("later", "earlier")):
        found = viewer.get(f"{URL}/{ids[first]}/comparison", params={"with": ids[second]}).raise_for_status().json()
        assert (found["before"], found["after"]) == (ids["earlier"], ids["later"])
        assert [(one["mechanism"], one["became"]) for one in found["findings"]] == [("backlash", "came")]
    refused = viewer.get(f"{URL}/{ids['later']}/comparison", params={"with": ids["other"]})
    assert (refused.status_code, "'once'" in refused.json()["detail"]) == (409, True)
    cookies = live_server.session("viewer")
    with httpx.Client(base_url=live_server.url, cookies=cookies) as browser:
        page = browser.get(f"/investigations/{ids['later']}").raise_for_status().text
        assert f'<option value="{ids["earlier"]}">' in page
        assert ids["other"] not in page
        shown = browser.get(f"/investigations/{ids['later']}/compare", params={"with": ids["earlier"]})
    assert "<h1>Came: backlash at output</h1>" in shown.raise_for_status().text
