"""Indexes for forgetting old jobs and finding due webhooks; and the count of a tenant's bytes."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"


def upgrade() -> None:
    """Add the columns and indexes, and fill them for existing rows."""
    # The defaults also serve a process of the version before that still writes while this one starts.
    op.add_column("jobs", sa.Column("erased", sa.Boolean, nullable=False, server_default=sa.false()))
    op.create_index("ix_jobs_state_finished_at", "jobs", ["state", "finished_at"])
    op.create_index("ix_idempotency_keys_job_id", "idempotency_keys", ["job_id"])

    tenant = sa.Column("tenant_id", sa.String(63), nullable=False, server_default="default")
    op.add_column("webhook_deliveries", tenant)
    op.execute(
        "UPDATE webhook_deliveries SET tenant_id = "
        "(SELECT tenant_id FROM webhook_endpoints WHERE webhook_endpoints.id = webhook_deliveries.endpoint_id)"
    )
    for name, columns, condition in (
        ("waiting", ["tenant_id", "due_at"], sa.text("state = 'pending' AND announced_at IS NULL")),
        ("under_way", ["tenant_id"], sa.text("state = 'pending' AND announced_at IS NOT NULL")),
    ):
        index = f"ix_webhook_deliveries_{name}"
        op.create_index(index, "webhook_deliveries", columns, sqlite_where=condition, postgresql_where=condition)
    op.drop_index("ix_webhook_deliveries_state_due_at", "webhook_deliveries")

    stored = sa.Column(
        "stored_bytes", sa.BigInteger().with_variant(sa.Integer, "sqlite"), nullable=False, server_default="0"
    )
    op.add_column("tenants", stored)
    op.execute(
        "INSERT INTO tenants (id, created_at) SELECT tenant_id, min(created_at) FROM jobs "
        "WHERE tenant_id NOT IN (SELECT id FROM tenants) GROUP BY tenant_id"
    )
    op.execute(
        "UPDATE tenants SET stored_bytes = coalesce((SELECT sum(size) FROM artifacts "
        "JOIN jobs ON jobs.id = artifacts.job_id WHERE jobs.tenant_id = tenants.id), 0)"
    )
