"""Events of jobs, and the webhooks that they are sent to."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Create the tables; the log begins empty for the jobs there are."""
    op.add_column("jobs", sa.Column("webhook", sa.String(2048)))
    op.add_column("jobs", sa.Column("event_count", sa.Integer, nullable=False, server_default="0"))
    op.create_table(
        "job_events",
        sa.Column("job_id", sa.String(36), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("type", sa.String(32), nullable=False),
        sa.Column("data", sa.JSON, nullable=False),
        sa.Column("created_at", sa.DateTime, nullable=False),
    )
    op.create_index("ix_job_events_created_at", "job_events", ["created_at"])
    op.create_table(
        "webhook_endpoints",
        sa.Column("id", sa.String(36), primary_key=True),
        sa.Column("tenant_id", sa.String(63), nullable=False),
        sa.Column("url", sa.String(2048)),
        sa.Column("events", sa.JSON, nullable=False),
        sa.Column("secret", sa.String(128), nullable=False),
        sa.Column("former_secret", sa.String(128)),
        sa.Column("former_secret_until", sa.DateTime),
        sa.Column("disabled_reason", sa.String(16)),
        sa.Column("created_at", sa.DateTime, nullable=False),
    )
    op.create_index("ix_webhook_endpoints_tenant_id", "webhook_endpoints", ["tenant_id"])
    endpoint = sa.ForeignKey("webhook_endpoints.id", ondelete="CASCADE")
    op.create_table(
        "webhook_deliveries",
        sa.Column("id", sa.String(36), primary_key=True),
        sa.Column("endpoint_id", sa.String(36), endpoint, nullable=False),
        sa.Column("job_id", sa.String(36), nullable=False),
        sa.Column("event_number", sa.Integer, nullable=False),
        sa.Column("url", sa.String(2048)),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("attempts", sa.Integer, nullable=False),
        sa.Column("due_at", sa.DateTime),
        sa.Column("announced_at", sa.DateTime),
        sa.Column("token", sa.Integer, nullable=False),
        sa.Column("created_at", sa.DateTime, nullable=False),
        sa.ForeignKeyConstraint(
            ["job_id", "event_number"], ["job_events.job_id", "job_events.number"], ondelete="CASCADE"
        ),
    )
    for columns in (("job_id", "event_number"), ("state", "due_at"), ("endpoint_id", "created_at", "id")):
        op.create_index(f"ix_webhook_deliveries_{'_'.join(columns)}", "webhook_deliveries", columns)
    delivery = sa.ForeignKey("webhook_deliveries.id", ondelete="CASCADE")
    op.create_table(
        "webhook_attempts",
        sa.Column("delivery_id", sa.String(36), delivery, primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("started_at", sa.DateTime, nullable=False),
        sa.Column("status", sa.Integer),
        sa.Column("error", sa.String),
        sa.Column("snippet", sa.String, nullable=False),
        sa.Column("seconds", sa.Double, nullable=False),
    )
