"""What is offered to be simulated can be, and damage has the name of the standard."""

from app.http.security import COOKIE, csrf_token
from benchmarks.harness.site import AXIS, Site, browsing
from sim.description.axis_document import parse_axis, read_axis
from sim.experiment.design_of_experiments import labels, labels_of, plan
from tests.web.reading import Markup


def test_every_label_that_is_offered_can_be_simulated() -> None:
    """The chain of the first case of each has the mechanism; teeth that nobody has counted cannot be damaged."""
    described = parse_axis(AXIS)
    geared = read_axis(described)
    for one in plan(geared, dict.fromkeys(labels_of(geared), 1)):
        one.scenario.specimen.train(one.scenario.specimen.built(one.scenario.axis, one.scenario.payload_kg_m2))
    assert set(labels_of(geared)) == set(labels())
    uncounted = read_axis({**described, "stages": [{"name": "output", "ratio": 100.0, "stiffness_n_m_per_rad": 1e5}]})
    assert {"notch", "mesh_error"} & set(labels_of(uncounted)) == set()
    assert "eccentricity" in labels_of(uncounted)


def test_cases_of_any_mechanism_are_ordered_by_the_form(site: Site) -> None:
    with browsing(site, "admin") as client:
        page = Markup(client.get("/library/simulate?axis=bench&label=eccentricity").raise_for_status().text)
        given = [given for tag, given in page.tags if tag == "input" and given.get("name") in ("label", "count")]
        asked = {"axis": "bench", "csrf": csrf_token(client.cookies[COOKIE])}
        fields = {name: [one["value"] for one in given if one["name"] == name] for name in ("label", "count")}
        answer = client.post("/library/simulate", data={**asked, **fields})
    assert set(fields["label"]) == set(labels())
    assert answer.status_code == 303
    job = answer.headers["location"].rsplit("/", 1)[1]
    with site.server.client() as client:
        client.delete(f"/api/v1/jobs/{job}").raise_for_status()
    assert dict(zip(fields["label"], fields["count"], strict=True))["eccentricity"] == "20"
    assert sum(map(int, fields["count"])) == 20
