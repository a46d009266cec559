"""The ledger's schema, step by step, for SQLite and PostgreSQL.

A step is a file in `versions/`: it is never changed once released, and it names its columns itself instead of taking
them from :mod:`service.jobs.models`, which moves on. A test compares where the steps lead with the models.
"""

import os
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, inspect

FIRST = "0001"


class NewerSchemaError(Exception):
    """The schema is that of a later version."""


def migrate(connection: Connection, revision: str = "head") -> None:
    """Bring the schema up to date, or to a step. Call inside a transaction in which no other process does the same.

    Tables made before there were migrations are those of the first step: they are adopted with what they hold.

    Raises:
        NewerSchemaError: it has steps that are not known here.
    """
    config = Config()
    config.set_main_option("script_location", os.fspath(Path(__file__).parent).replace("%", "%%"))
    config.attributes["connection"] = connection
    tables = inspect(connection).get_table_names()
    if "jobs" in tables and "alembic_version" not in tables:
        command.stamp(config, FIRST)
    known = {step.revision for step in ScriptDirectory.from_config(config).walk_revisions()}
    if unknown := set(MigrationContext.configure(connection).get_current_heads()) - known:
        raise NewerSchemaError(", ".join(sorted(unknown)))
    command.upgrade(config, revision)
