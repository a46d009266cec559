"""Queues and priorities of jobs; and the unique id of the ledger."""

import uuid

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Add the columns, put the jobs there are into the queue that every worker serves, and draw the identity."""
    # The defaults also serve a process of the version before that still writes while this one starts.
    op.add_column("jobs", sa.Column("queue", sa.String(16), nullable=False, server_default="small"))
    op.add_column("jobs", sa.Column("priority", sa.Integer, nullable=False, server_default="1"))
    waiting = ["state", "queue", "tenant_id", "priority", "created_at"]
    op.create_index("ix_jobs_state_queue_tenant_id_priority_created_at", "jobs", waiting)
    op.create_index("ix_jobs_queue_tenant_id_started_at", "jobs", ["queue", "tenant_id", "started_at"])
    identity = op.create_table("ledger_identity", sa.Column("id", sa.String(36), primary_key=True))
    op.bulk_insert(identity, [{"id": str(uuid.uuid4())}])
