"""Robots in the library: what an older database holds of them is still known."""

import json

from alembic import command
from sqlalchemy import text

from casebase.database import WRITING, migration_config, upgrade_database
from casebase.library import CaseLibrary
from casebase.models import StoredInvestigation

ASKED = {"inputs": {"urdf": {"sha256": "0"}}, "axis_document": {"name": "old arm", "joints": []}}


def test_investigations_of_an_older_database_are_found_by_the_name_of_their_robot(library: CaseLibrary) -> None:
    with library.engine.connect().execution_options(**{WRITING: True}) as connection, connection.begin():
        command.downgrade(migration_config(connection), "0003")
        for identity, axis in (("a", None), ("b", "elbow")):
            connection.execute(
                text(
                    "INSERT INTO investigations (id, state, axis, axis_document, inputs, created_at, created_by) "
                    "VALUES (:id, 'done', :axis, :document, :inputs, '2026-11-01T00:00:00+00:00', 'test')"
                ),
                {"id": identity, "axis": axis, **_sent()},
            )
    upgrade_database(library.engine)
    with library.reading() as session:
        found = {identity: session.get_one(StoredInvestigation, identity) for identity in "ab"}
    assert [(row.axis, row.robot, row.subject) for row in found.values()] == [
        (None, "old arm", "old arm"),
        ("elbow", None, "elbow"),
    ]


def _sent() -> dict[str, str]:
    return {"document": json.dumps(ASKED["axis_document"]), "inputs": json.dumps(ASKED["inputs"])}
