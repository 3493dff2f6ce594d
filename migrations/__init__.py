"""Alembic migrations of the library; run by `casebase.database.upgrade_database`."""
