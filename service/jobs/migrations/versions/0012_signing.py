"""Moments at which results are to be signed."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    """Add the column and its index."""
    op.add_column("jobs", sa.Column("sign_at", sa.DateTime, nullable=True))
    condition = sa.text("sign_at IS NOT NULL")
    op.create_index("ix_jobs_sign_at", "jobs", ["sign_at"], sqlite_where=condition, postgresql_where=condition)
