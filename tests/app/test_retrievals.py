"""Nearest cases over HTTP and by command: who may ask, what is refused, that nothing is stored, and who is near."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from sqlalchemy import inspect, text

from app.main import create_app
from benchmarks.harness.live import LiveServer, gearcase, started
from benchmarks.harness.sounds import hum, sound, wav
from casebase.library import CaseLibrary
from casebase.reasoning.priors import prior_of
from casebase.search.case_table import CaseTable
from casebase.search.similarity import LIMIT, pooled_scales
from casebase.store.database import create_engine_for, sqlite_url

RETRIEVALS = "/api/v1/retrievals"
CREST = ("crest_factor_low_pass_200_hz_whole_record", "crest_factor_low_pass_200_hz_mean_of_1_s_windows")
BY_ITSELF = {"api_keys", "artifacts"}
"""Tables that the service writes besides: when a key was used last, and what it learned of its cases."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A service with twelve cases of two labels, three gearboxes and two axes."""
    server = started(tmp_path_factory.mktemp("retrievals") / "data")
    with server.client() as admin:
        for seed in range(6):
            for label, impacts in (("normal", False), ("notch", True)):
                metadata = {"label": label, "gearbox": f"g{seed % 3}", "axis": "ab"[seed % 2]}
                content = sound(seed + 50 * impacts, impacts=impacts)
                data = {"metadata": json.dumps(metadata)}
                admin.post("/api/v1/cases", files={"file": ("x.wav", content)}, data=data).raise_for_status()
    yield server
    server.stop()


@pytest.fixture
def viewer(server: LiveServer) -> Iterator[httpx.Client]:
    with server.client("viewer") as client:
        yield client


@pytest.fixture(scope="module")
def table(server: LiveServer) -> CaseTable:
    library = CaseLibrary.open(server.data_dir)
    with library.reading() as session:
        found = library.retrieve.table(session)
    library.close()
    return found


def ask(client: httpx.Client, content: bytes | None, **query: object) -> httpx.Response:
    parts: dict[str, Any] = {"query": (None, json.dumps(query), "application/json")}
    if content is not None:
        parts["file"] = ("x.wav", content)
    return client.post(RETRIEVALS, files=parts)


def test_answer(viewer: httpx.Client, table: CaseTable) -> None:
    answer = ask(viewer, sound(7, impacts=True), k=4).json()
    assert (answer["representation"], answer["k"], answer["library_version"]) == ("full", 4, table.version)
    assert len(answer["neighbours"]) == 4
    assert answer["features"] == [name for name in table.names if prior_of(name)[0] > 0]
    assert answer["weights"]["notch_bump_12_200_hz"] == prior_of("notch_bump_12_200_hz")[0]
    distances = [each["distance"] for each in answer["neighbours"]]
    assert distances == sorted(distances)
    for each in answer["neighbours"]:
        case = viewer.get(f"/api/v1/cases/{each['case_id']}").json()
        taken = case["recording"]
        assert (each["label"], each["origin"]) == (case["label"], case["origin"])
        assert (each["axis"], each["gearbox"]) == (taken["axis"], taken["gearbox"])
        assert each["similarity"] == pytest.approx(1 / (1 + each["distance"]))
        shares = [part["share"] for part in each["contributions"].values()]
        assert sum(shares) == pytest.approx(1, rel=1e-6)
        assert shares == sorted(shares, reverse=True)
        stored = viewer.get(f"/api/v1/recordings/{taken['id']}/features").json()["features"]
        known = {feature["name"]: feature for feature in stored}
        for name, part in each["contributions"].items():
            assert part["unit"] == known[name]["unit"]
            assert part["case"] == pytest.approx(known[name]["value"])


def test_quality_and_motion_are_those_of_a_diagnosis(server: LiveServer, viewer: httpx.Client) -> None:
    for seconds, period in ((3.0, None), (6.0, pytest.approx(2.0, abs=0.2))):
        content = sound(8, seconds=seconds)
        heard = ask(viewer, content).json()
        with server.client("operator") as client:
            made = client.post("/api/v1/diagnoses", files={"file": ("x.wav", content)}).raise_for_status().json()
        stored = ask(viewer, None, recording_id=made["recording"]["id"]).json()
        assert heard["quality"] == stored["quality"] == made["quality"] != []
        assert heard["motion_period_s"] == stored["motion_period_s"] == period


def test_example_of_the_document_runs(viewer: httpx.Client) -> None:
    body = create_app().openapi()["paths"][RETRIEVALS]["post"]["requestBody"]["content"]["multipart/form-data"]
    example = body["schema"]["properties"]["query"]["examples"][0]
    answer = ask(viewer, sound(7), **example)
    assert answer.status_code == 200
    assert len(answer.json()["neighbours"]) == example["k"]


def everything(data_dir: Path) -> dict[str, object]:
    """Every row that a request could have written, and every file of the data folder but the database."""
    engine = create_engine_for(sqlite_url(data_dir / "gearcase.db"))
    with engine.connect() as connection:
        names = set(inspect(connection).get_table_names()) - BY_ITSELF
        rows = {name: sorted(map(repr, connection.execute(text(f'SELECT * FROM "{name}"')))) for name in names}
    rows["audit"] = [row for row in rows["audit"] if "artifact." not in row]
    engine.dispose()
    files = {str(path): path.stat().st_mtime_ns for path in data_dir.rglob("*") if path.is_file()}
    return {**rows, "files": {path: when for path, when in files.items() if "gearcase.db" not in path}}


def test_nothing_is_stored(server: LiveServer, viewer: httpx.Client) -> None:
    before = everything(server.data_dir)
    assert before["cases"]
    for content in (sound(1234, impacts=True), b"this is no sound", sound(1235)[:3000]):
        ask(viewer, content)
    found = ask(viewer, sound(1236), representation="paper").json()["neighbours"]
    assert ask(viewer, None, case_id=found[0]["case_id"]).status_code == 200
    assert everything(server.data_dir) == before


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ({"k": 0}, "k: "),
        ({"k": 101}, "k: "),
        ({"representation": "wavelets"}, "'full' or 'paper'"),
        ({"weights": {"crest_facto_median": 1}}, "crest_factor_median_of_cycles"),
        ({"weights": {"crest_factor": -1}}, "greater than or equal to 0"),
        ({"weights": {"": 0}}, "all are 0"),
        ({"origin": "heard"}, "'measured' or 'simulated'"),
        ({"label": []}, "label"),
        ({"min_similarity": 2}, "min_similarity"),
        ({"neighbours": 3}, "Known: k, representation"),
        ({"case_id": "0" * 32}, "leave out file"),
        ({"case_id": "0" * 32, "recording_id": "0" * 32}, "ask for one"),
        ({"case_id": "x"}, "case_id"),
    ],
)
def test_bad_query_is_422_and_says_what_would_be_right(
    viewer: httpx.Client, query: dict[str, object], words: str
) -> None:
    answer = ask(viewer, sound(7), **query)
    assert answer.status_code == 422
    assert words in answer.json()["detail"]


def test_bad_files(viewer: httpx.Client) -> None:
    assert ask(viewer, b"this is no sound").status_code == 415
    assert ask(viewer, wav(hum(0.02, 1))).status_code == 422
    missing = ask(viewer, None, k=3)
    assert missing.status_code == 422
    assert "case_id" in missing.json()["detail"]
    assert viewer.post(RETRIEVALS, json={"k": 3}).status_code == 415
    assert viewer.post(RETRIEVALS, files={"file": sound(1), "axis": b"x"}).status_code == 422
    assert viewer.post(RETRIEVALS, files={"file": sound(1)}, data={"query": "{k: 3"}).status_code == 422


def test_what_is_stored_is_asked_for_by_its_id(viewer: httpx.Client) -> None:
    case = viewer.get("/api/v1/cases?label=notch").json()["items"][0]
    by_case, by_recording = (
        ask(viewer, None, k=100, **names).json()["neighbours"]
        for names in ({"case_id": case["id"]}, {"recording_id": case["recording"]["id"]})
    )
    assert by_case == by_recording
    assert len(by_case) == 11
    assert case["id"] not in {each["case_id"] for each in by_case}
    assert ask(viewer, None, case_id="0" * 32).status_code == 404
    assert ask(viewer, None, recording_id="0" * 32).status_code == 404


def by_brute_force(
    table: CaseTable, weights: NDArray[np.float64], query: NDArray[np.float64]
) -> list[tuple[str, float]]:
    """Return id and distance of every case, nearest first, as `casebase.search.similarity` defines it, in numpy."""
    center, scale = pooled_scales(table.values, table.labels)
    cases, point = (np.clip((x - center) / scale, -LIMIT, LIMIT) for x in (table.values.astype(np.float64), query))
    present = np.isfinite(point)
    parts = np.where(np.isfinite(cases), (cases - point) ** 2, point**2 + 1)[:, present] * weights[present]
    distances = np.sqrt(parts.sum(axis=1) / weights[present].sum())
    return sorted(zip(table.ids.tolist(), distances.tolist(), strict=True), key=lambda pair: (pair[1], pair[0]))


@pytest.mark.parametrize("instead", [{}, {"": 0.0, "kurtosis": 1.0, "crest_factor": 2.0}, {"band_level": 3.0}])
@pytest.mark.parametrize("representation", ["full", "paper"])
def test_same_neighbours_as_brute_force(
    viewer: httpx.Client, table: CaseTable, representation: str, instead: dict[str, float]
) -> None:
    default = {
        "full": [prior_of(name)[0] for name in table.names],
        "paper": [float(name in CREST or name.startswith("band_level_")) for name in table.names],
    }
    weights = np.array(default[representation])
    for beginning, weight in sorted(instead.items()):
        weights[[name.startswith(beginning) for name in table.names]] = weight
    content = sound(900, impacts=True)
    answer = ask(viewer, content, k=100, representation=representation, weights=instead).json()
    parts = answer["neighbours"][0]["contributions"]
    query = np.array([parts[name]["query"] if name in parts else np.nan for name in table.names])
    expected = by_brute_force(table, weights, query)
    found = [(each["case_id"], each["distance"]) for each in answer["neighbours"]]
    assert [each for each, _ in found] == [each for each, _ in expected]
    np.testing.assert_allclose([each for _, each in found], [each for _, each in expected], rtol=1e-4)


def test_filters(viewer: httpx.Client) -> None:
    def found(**query: object) -> list[dict[str, Any]]:
        neighbours: list[dict[str, Any]] = ask(viewer, sound(7), k=100, **query).json()["neighbours"]
        return neighbours

    whole = found()
    for key, values in (("label", ["notch"]), ("gearbox", ["g0", "g2"]), ("axis", ["b"]), ("origin", ["measured"])):
        expected = [each for each in whole if each[key] in values]
        assert found(**{key: values}) == expected
        if len(values) == 1:
            assert found(**{key: values[0]}) == expected
    assert found(label="notch", axis="a", gearbox="g0") == [
        each for each in whole if (each["label"], each["axis"], each["gearbox"]) == ("notch", "a", "g0")
    ]
    limit = whole[3]["similarity"]
    assert found(min_similarity=limit) == whole[:4]
    nowhere = ask(viewer, sound(7), label="notsch").json()
    assert nowhere["neighbours"] == []
    assert any("normal, notch" in remark for remark in nowhere["remarks"])
    assert found(origin="simulated") == []


def test_command_says_what_the_service_says(server: LiveServer, viewer: httpx.Client, tmp_path: Path) -> None:
    path = tmp_path / "x.wav"
    path.write_bytes(sound(901, impacts=True))
    asked = ("--k", "3", "--representation", "paper", "--label", "notch", "--weight", "crest_factor=4")
    done = gearcase("retrieve", path, *asked, "--json", data_dir=server.data_dir)
    query = {"k": 3, "representation": "paper", "label": ["notch"], "weights": {"crest_factor": 4}}
    assert done.code == 0
    assert json.loads(done.stdout) == ask(viewer, path.read_bytes(), **query).json()
    words = gearcase("retrieve", path, "--k", "3", data_dir=server.data_dir)
    assert words.code == 0
    assert "gearbox" in words.stdout
