"""More ways in: assets that a worker is to download,
such as are sent ahead, such as are dropped in a bucket, and results that exist already."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Create the tables and columns."""
    op.create_table(
        "job_sources",
        sa.Column("job_id", sa.String(36), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("url", sa.String(2048), nullable=False),
    )
    op.create_table(
        "uploads",
        sa.Column("id", sa.String(36), primary_key=True),
        sa.Column("tenant_id", sa.String(63), sa.ForeignKey("tenants.id"), nullable=False),
        sa.Column("filename", sa.String(255), nullable=False),
        sa.Column("size", sa.BigInteger().with_variant(sa.Integer, "sqlite"), nullable=False),
        sa.Column("sha256", sa.String(64)),
        sa.Column("created_at", sa.DateTime, nullable=False),
        sa.Column("expires_at", sa.DateTime, nullable=False),
    )
    op.create_index("ix_uploads_expires_at", "uploads", ["expires_at"])
    op.create_index("ix_uploads_tenant_id_expires_at", "uploads", ["tenant_id", "expires_at"])
    op.add_column("jobs", sa.Column("result_key", sa.String(64)))
    op.add_column("jobs", sa.Column("cached", sa.Boolean, nullable=False, server_default=sa.false()))
    op.create_index("ix_jobs_tenant_id_result_key", "jobs", ["tenant_id", "result_key"])
    op.create_table(
        "dropped_objects",
        sa.Column("id", sa.String(64), primary_key=True),
        sa.Column("job_id", sa.String(36), sa.ForeignKey("jobs.id", ondelete="CASCADE"), nullable=False, unique=True),
        sa.Column("source", sa.String(63), nullable=False),
        sa.Column("key", sa.String(1024), nullable=False),
        sa.Column("output", sa.String(16), nullable=False),
        sa.Column("tries", sa.Integer, nullable=False),
        sa.Column("due_at", sa.DateTime, nullable=False),
        sa.Column("created_at", sa.DateTime, nullable=False),
    )
    op.create_index("ix_dropped_objects_output_due_at", "dropped_objects", ["output", "due_at"])
    op.create_index("ix_dropped_objects_source_key", "dropped_objects", ["source", "key"])
