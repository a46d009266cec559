"""Tenants and their API keys. The jobs there are, and those of a service without keys, are the default tenant's."""

from datetime import UTC, datetime

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Create both tables and the default tenant, and say of each job whose it is."""
    tenants = op.create_table(
        "tenants",
        sa.Column("id", sa.String(63), primary_key=True),
        sa.Column("created_at", sa.DateTime, nullable=False),
    )
    op.bulk_insert(tenants, [{"id": "default", "created_at": datetime.now(UTC).replace(tzinfo=None)}])
    op.create_table(
        "api_keys",
        sa.Column("id", sa.String(8), primary_key=True),
        sa.Column("tenant_id", sa.String(63), sa.ForeignKey("tenants.id"), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("secret_sha256", sa.String(64), nullable=False),
        sa.Column("scopes", sa.JSON, nullable=False),
        sa.Column("created_at", sa.DateTime, nullable=False),
        sa.Column("last_used_at", sa.DateTime),
        sa.Column("expires_at", sa.DateTime),
        sa.Column("revoked_at", sa.DateTime),
        sa.Column("spent_until", sa.Double, nullable=False),
    )
    # No foreign key: SQLite adds none to a table that has rows. The default also serves a process of the version before
    # that still writes while this one starts.
    op.add_column("jobs", sa.Column("tenant_id", sa.String(63), nullable=False, server_default="default"))
    op.create_index("ix_jobs_tenant_id_state", "jobs", ["tenant_id", "state"])
