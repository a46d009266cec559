"""Correlation of a job's log lines and spans with those of its request."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    """Add the column; jobs from before have nothing in it."""
    op.add_column("jobs", sa.Column("correlation", sa.JSON, nullable=False, server_default="{}"))
