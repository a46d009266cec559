"""Retention of a job's files; and files larger than 2 GiB."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add both columns, null for the jobs there are, which are kept."""
    op.add_column("jobs", sa.Column("expires_at", sa.DateTime))
    op.add_column("jobs", sa.Column("purge_at", sa.DateTime))
    op.create_index("ix_jobs_purge_at", "jobs", ["purge_at"])
    if op.get_bind().dialect.name != "sqlite":  # whose integers are of any size
        op.alter_column("artifacts", "size", type_=sa.BigInteger)
