"""Jobs of more than one kind: watermarks, and verifications."""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"


def upgrade() -> None:
    """Add the column; existing jobs are watermarks. Lists are of one kind, and so is their index."""
    op.add_column("jobs", sa.Column("kind", sa.String(16), nullable=False, server_default="watermark"))
    op.create_index("ix_jobs_tenant_id_kind_created_at_id", "jobs", ["tenant_id", "kind", "created_at", "id"])
    op.drop_index("ix_jobs_tenant_id_created_at_id", "jobs")
