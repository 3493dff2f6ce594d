"""Alembic's entry: runs the revisions on the connection that the caller opened."""

from alembic import context

from casebase.store.models import Base

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=Base.metadata,
    transactional_ddl=True,
)
context.run_migrations()
