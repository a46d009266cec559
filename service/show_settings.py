"""Output of `python -m service --show-settings`: every setting, its value, and its origin."""

import os
import re
from collections.abc import Mapping
from pathlib import Path

from service.config import PREFIX, SECRETS, Settings

MASK = "**********"  # as pydantic writes a secret
PASSWORD = re.compile(r"(://[^:/@]*:)[^@/]+@")
PASSWORD_PARAMETER = re.compile(r"(?i)((?:password|passfile|secret|token)=)[^&]+")
NOT_OURS = {f"{PREFIX}MODELS"}  # the engine's own: where its optional weights lie


def show_settings(
    settings: Settings, environment: Mapping[str, str] = os.environ, secrets: Path = SECRETS
) -> list[tuple[str, str, str]]:
    """List each setting as (variable, masked value, origin), then variables that look like one and are none."""
    given = {name.upper() for name, value in environment.items() if value}
    filed = {path.name.upper() for path in secrets.iterdir()} if secrets.is_dir() else set()

    def origin(variable: str) -> str:
        if variable in given:
            return "environment"
        return f"file in {secrets}" if variable in filed else "default"

    variables = {f"{PREFIX}{name.upper()}": value for name, value in settings}
    rows = [(variable, without_secrets(as_variable(value)), origin(variable)) for variable, value in variables.items()]
    unknown = {name for name in given | filed if name.startswith(PREFIX)} - variables.keys() - NOT_OURS
    return rows + [(name, "(not a setting: ignored)", origin(name)) for name in sorted(unknown)]


def as_variable(value: object) -> str:
    """Format a setting's value as in its variable."""
    if isinstance(value, tuple | frozenset):
        return ",".join(map(str, sorted(value) if isinstance(value, frozenset) else value))
    return "" if value is None else str(value)


def without_secrets(value: str) -> str:
    """Mask the passwords of a URL."""
    return PASSWORD_PARAMETER.sub(rf"\g<1>{MASK}", PASSWORD.sub(rf"\g<1>{MASK}@", value))
