"""Room for the secrets of webhooks when they are encrypted."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"


def upgrade() -> None:
    """Widen the columns; their values are encrypted by a service with a key at its start."""
    for name in ("secret", "former_secret"):
        nullable = name == "former_secret"
        if op.get_bind().dialect.name == "sqlite":  # which alters no type, and would lose what refers to a new table
            default = None if nullable else ""
            op.add_column(
                "webhook_endpoints", sa.Column("wide", sa.String(255), nullable=nullable, server_default=default)
            )
            op.execute(f"UPDATE webhook_endpoints SET wide = {name}")
            op.drop_column("webhook_endpoints", name)
            op.execute(f"ALTER TABLE webhook_endpoints RENAME COLUMN wide TO {name}")
        else:
            op.alter_column("webhook_endpoints", name, type_=sa.String(255), existing_nullable=nullable)
