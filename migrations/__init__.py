"""Alembic migrations of the library; run by `casebase.store.database.upgrade_database`."""

NEWEST = "3"
"""The revision that a database is at when there is nothing to do; a new migration changes it."""
