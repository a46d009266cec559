"""What `python -m service --show-settings` prints: every setting, its value, and where that comes from."""

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
    """Each setting as (variable, value without what is secret, origin), then what looks like one and is none."""
    given = {name.upper() for name, value in environment.items() if value}
    filed = {path.name.upper() for path in secrets.iterdir()} if secrets.is_dir() else set()

    def origin(variable: str) -> str:
        if variable in given:
            return "environment"
        return f"file in {secrets}" if variable in filed else "default"

    variables = {f"{PREFIX}{name.upper()}": value for name, value in settings}
    rows = [(variable, without_secrets(as_variable(value)), origin(variable)) for variable, value in variables.items()]
    strangers = {name for name in given | filed if name.startswith(PREFIX)} - variables.keys() - NOT_OURS
    return rows + [(name, "(not a setting: ignored)", origin(name)) for name in sorted(strangers)]


def as_variable(value: object) -> str:
    """A setting's value as its variable says it."""
    if isinstance(value, tuple | frozenset):
        return ",".join(map(str, sorted(value) if isinstance(value, frozenset) else value))
    return "" if value is None else str(value)


def without_secrets(value: str) -> str:
    """A value without the password of a URL."""
    return PASSWORD_PARAMETER.sub(rf"\g<1>{MASK}", PASSWORD.sub(rf"\g<1>{MASK}@", value))
