"""Configuration of upload hooks, a TOML file: see docker/hooks.example.toml."""

import re
import tomllib
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SecretStr,
    StringConstraints,
    TypeAdapter,
    ValidationError,
    field_validator,
    model_validator,
)

from core.artwork.qr_code import check_code
from core.errors import MeshmarkError
from core.parameters import Parameters, parse_parameters
from service.jobs.models import DEFAULT_TENANT

SUFFIXES = (".glb", ".gltf", ".obj", ".stl", ".ply", ".off", ".3mf", ".dae", ".zip")
FROM_FILE = "_file"  # `token_file = "/run/secrets/token"`: the value of `token` is the content of that file

Name = Annotated[str, StringConstraints(pattern="^[a-z0-9][a-z0-9-]{0,62}$")]
Origin = Annotated[str, StringConstraints(to_lower=True, pattern=r"^[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?$")]
Prefix = Annotated[str, Field(min_length=1, max_length=500, pattern="^[^/].*/$")]


class HookSource(BaseModel):
    """Watched bucket or part of one, the credentials of its sender, and the parameters of its jobs."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["s3", "cloudevents"]
    token: SecretStr | None = None
    token_header: str = "Authorization"
    hmac_secret: SecretStr | None = None
    hmac_header: str = "X-Hub-Signature-256"
    origins: tuple[Origin, ...] = ()  # of senders that ask whether they may send: see service.hooks.handshake
    tenant: Name = DEFAULT_TENANT
    bucket: Annotated[str, Field(pattern="^[a-z0-9][a-z0-9.-]*$")]
    endpoint: Annotated[str, Field(pattern="^$|^https?://")] = ""
    region: str = ""
    access_key_id: SecretStr = SecretStr("")
    secret_access_key: SecretStr = SecretStr("")
    input_prefix: Prefix
    output_prefix: Prefix
    suffixes: tuple[str, ...] = SUFFIXES
    parameters: Parameters

    @model_validator(mode="before")
    @classmethod
    def _secrets_from_files(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        read = {key: value for key, value in given.items() if not key.endswith(FROM_FILE)}
        for key in given.keys() - read.keys():
            try:
                read[key.removesuffix(FROM_FILE)] = Path(given[key]).read_text().strip()
            except (OSError, TypeError, UnicodeError):
                raise ValueError(f"{key} names no file that can be read") from None
        return read

    @field_validator("parameters", mode="before")
    @classmethod
    def _parameters(cls, given: Any) -> Any:
        try:
            parameters = parse_parameters(given) if isinstance(given, dict) else given
            if isinstance(parameters, Parameters):
                parameters.require_content(logo=False)
                check_code(parameters)
            return parameters
        except MeshmarkError as error:
            raise ValueError(f"{error.message} {error.remedy}") from None

    @field_validator("suffixes")
    @classmethod
    def _lower(cls, suffixes: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(suffix.lower() for suffix in suffixes)

    @model_validator(mode="after")
    def _is_guarded(self) -> Self:
        secrets = [secret.get_secret_value() for secret in (self.token, self.hmac_secret) if secret is not None]
        if len(secrets) != 1 or len(secrets[0]) < 16:
            raise ValueError("it needs either a token or an hmac_secret, of 16 characters or more")
        if self.origins and self.kind != "cloudevents":
            raise ValueError("origins are of senders of CloudEvents: they go with kind cloudevents")
        if bool(self.access_key_id.get_secret_value()) != bool(self.secret_access_key.get_secret_value()):
            raise ValueError("access_key_id and secret_access_key go together")
        return self

    def output_key(self, key: str, suffix: str) -> str:
        """Key of an output that was made from the object at a key."""
        return self.output_prefix + key.removeprefix(self.input_prefix) + suffix


class HooksFile(BaseModel):
    """Schema of the hooks file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    sources: Annotated[dict[Name, HookSource], Field(min_length=1)]

    @model_validator(mode="after")
    def _never_feeds_itself(self) -> Self:
        for (name, one), (other_name, other) in product(self.sources.items(), repeat=2):
            if (one.endpoint.rstrip("/"), one.bucket) != (other.endpoint.rstrip("/"), other.bucket):
                continue
            written, read = one.output_prefix, other.input_prefix
            if written.startswith(read) or read.startswith(written):
                raise ValueError(
                    f"what {name} writes under {written} would be read by {other_name} from {read}: "
                    "neither prefix may begin with the other"
                )
        return self


FILE = TypeAdapter(HooksFile)


def load_hooks(path: Path) -> Mapping[str, HookSource]:
    """Sources in a file, by name.

    Raises:
        ValueError: it cannot be read, or something in it cannot work; the message says what, and holds no secret.
    """
    try:
        return FILE.validate_python(tomllib.loads(path.read_text())).sources
    except (OSError, UnicodeError):
        raise ValueError(f"{path} cannot be read") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is no TOML: {re.sub(r'[^ -~]', '?', str(error))}") from None
    except ValidationError as error:
        problems = [
            f"{'.'.join(map(str, item['loc'])) or path}: {item['msg'].removeprefix('Value error, ')}"
            for item in error.errors(include_input=False, include_url=False)
        ]
        raise ValueError("; ".join(problems)) from None


def secret_files(path: Path) -> list[Path]:
    """Files that hold secrets of the hooks in a file."""
    sources = tomllib.loads(path.read_text())["sources"].values()
    return [Path(value) for source in sources for name, value in source.items() if name.endswith(FROM_FILE)]
