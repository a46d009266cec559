"""Copies: jobs that take the places of another one's marks, and wait for it."""

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"


def upgrade() -> None:
    """Add the columns, and the index that a job's copies are listed by."""
    op.add_column("jobs", sa.Column("copy_of", sa.String(36), nullable=True))
    op.add_column("jobs", sa.Column("held", sa.Boolean, nullable=False, server_default=sa.false()))
    condition = sa.text("copy_of IS NOT NULL")
    op.create_index(
        "ix_jobs_copy_of_created_at_id",
        "jobs",
        ["copy_of", "created_at", "id"],
        sqlite_where=condition,
        postgresql_where=condition,
    )
