"""Settings: every one is an environment variable `MESHMARK_<NAME>`."""

import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, SecretStr, ValidationError, field_validator, model_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError

from core.artwork.fonts import MAX_FONT_BYTES
from core.artwork.svg_tree import MAX_LOGO_BYTES
from core.budgets import DEFAULT_BUDGETS, Budgets
from service.hooks.config import HookSource, load_hooks
from service.outbound.policy import PORTS, Policy
from service.webhooks.vault import read_keys

MIB = 2**20
PREFIX = "MESHMARK_"
# Largest values of settings: beyond any real need, and safe in the arithmetic of times, threads and system limits.
MOST, MOST_BYTES = 10**9, 2**50
DAY, YEAR = 86_400.0, 365 * 86_400.0  # seconds
PortNumber = Annotated[int, Field(ge=1, le=65535)]
SECRETS = Path("/run/secrets")  # where Docker and Kubernetes mount secrets


class Settings(BaseSettings):
    """Settings of the API, the worker and the embedded service, read at start."""

    model_config = SettingsConfigDict(env_prefix=PREFIX, env_ignore_empty=True, extra="ignore")

    host: Annotated[str, Field(description="Address the API listens on.")] = "127.0.0.1"
    auth: Annotated[
        str,
        Field(
            pattern="^(none|keys)$",
            description="`keys`: requests need an API key; `none`: they do not, and the API listens on loopback only.",
        ),
    ] = "none"
    requests_per_minute: Annotated[
        int,
        Field(ge=0, le=MOST, description="Requests a minute each API key may make, at once or evenly; 0: any number."),
    ] = 6000
    max_active_jobs: Annotated[
        int,
        Field(
            ge=0,
            le=MOST,
            description="Jobs of a tenant that may wait and run at a time, and uploads it may have; 0: any number.",
        ),
    ] = 10_000
    max_uploads_at_once: Annotated[
        int,
        Field(ge=0, le=MOST, description="Assets of a tenant that one API process takes in at a time; 0: any number."),
    ] = 32
    max_connections: Annotated[
        int, Field(ge=1, le=100_000, description="Connections that one API process has open at a time.")
    ] = 1000
    client_timeout: Annotated[
        float,
        Field(
            ge=0.1,
            le=3600,
            description="Seconds in which a request's headers must come, and for which its body or whoever takes the "
            "answer may stand still.",
        ),
    ] = 30.0
    client_rate: Annotated[
        int, Field(gt=0, le=MOST, description="Bytes a second at which a body must come, on average.")
    ] = 4096
    max_stored_bytes: Annotated[
        int,
        Field(
            ge=0,
            le=MOST_BYTES,
            description="Bytes that may be stored for a tenant when one more job or upload is accepted; 0: any number.",
        ),
    ] = 0
    console: Annotated[bool, Field(description="Serve the console, pages for people, at `/`.")] = True
    public_verification: Annotated[
        bool,
        Field(description="With `auth` `keys`, let anybody verify files without a key, at a rate by address."),
    ] = False
    public_verifications_per_minute: Annotated[
        int,
        Field(ge=1, le=MOST, description="Verifications a minute that may come from an address without a key."),
    ] = 6
    port: Annotated[int, Field(ge=0, le=65535, description="Port the API listens on; 0 takes any free one.")] = 8080
    metrics_host: Annotated[
        str, Field(description="Address of the metrics, which need no key: one that only your Prometheus reaches.")
    ] = "127.0.0.1"
    metrics_port: Annotated[int, Field(ge=0, le=65535, description="Port of the API's metrics; 0: none.")] = 0
    worker_metrics_port: Annotated[int, Field(ge=0, le=65535, description="Port of a worker's metrics; 0: none.")] = 0
    webhooks_metrics_port: Annotated[
        int, Field(ge=0, le=65535, description="Port of the metrics of a sender of webhooks; 0: none.")
    ] = 0
    signer_metrics_port: Annotated[int, Field(ge=0, le=65535, description="Port of a signer's metrics; 0: none.")] = 0
    data_dir: Annotated[
        Path, Field(description="Folder of scratch files, and of the default ledger, broker and artifact store.")
    ] = Path("data")
    database_url: Annotated[
        str,
        Field(
            pattern=r"^$|^(sqlite|postgresql(\+psycopg)?)://",
            description="Job ledger: `postgresql://user:password@host/name`, or `sqlite:///path`; empty: in data_dir.",
        ),
    ] = ""
    broker_url: Annotated[
        str,
        Field(
            pattern=r"^(filesystem|rediss?)://",
            description="Queue: `redis://...`, or `filesystem://` for files in data_dir and no server.",
        ),
    ] = "filesystem://"
    store_url: Annotated[
        str,
        Field(
            pattern=r"^$|^s3://[a-z0-9][a-z0-9.-]*(/.*)?$",
            description="Artifact store: `s3://bucket/prefix`; empty: a folder in data_dir.",
        ),
    ] = ""
    s3_endpoint: Annotated[
        str,
        Field(pattern="^$|^https?://", description="URL of a store that speaks S3; empty: Amazon's own."),
    ] = ""
    s3_region: Annotated[str, Field(description="Region of the bucket; empty: as the store has it.")] = ""
    s3_access_key_id: Annotated[
        SecretStr, Field(description="Access key; empty: `AWS_ACCESS_KEY_ID`, or the machine's role.")
    ] = SecretStr("")
    s3_secret_access_key: Annotated[SecretStr, Field(description="The access key's secret.")] = SecretStr("")
    s3_presign: Annotated[
        bool,
        Field(description="Let clients download and upload by presigned links to the bucket, which they must reach."),
    ] = False
    max_upload_bytes: Annotated[int, Field(gt=0, le=MOST_BYTES, description="Largest asset accepted, in bytes.")] = (
        DEFAULT_BUDGETS.bytes
    )
    max_unpacked_bytes: Annotated[
        int, Field(gt=0, le=MOST_BYTES, description="Largest content of an archive accepted, unpacked, in bytes.")
    ] = DEFAULT_BUDGETS.unpacked_bytes
    max_faces: Annotated[int, Field(gt=0, le=MOST, description="Most triangles an asset may draw.")] = (
        DEFAULT_BUDGETS.faces
    )
    max_vertices: Annotated[int, Field(gt=0, le=MOST, description="Most vertices an asset may draw.")] = (
        DEFAULT_BUDGETS.vertices
    )
    max_image_pixels: Annotated[
        int, Field(gt=0, le=MOST_BYTES, description="Most pixels all textures of an asset may have together.")
    ] = DEFAULT_BUDGETS.image_pixels
    max_font_bytes: Annotated[int, Field(gt=0, le=MAX_FONT_BYTES, description="Largest font accepted, in bytes.")] = (
        MAX_FONT_BYTES
    )
    max_logo_bytes: Annotated[int, Field(gt=0, le=MAX_LOGO_BYTES, description="Largest logo accepted, in bytes.")] = (
        MAX_LOGO_BYTES
    )
    intake_concurrency: Annotated[
        int,
        Field(
            ge=1,
            le=64,
            description="Uploads an API looks through at the same time, of one tenant one less, each in a process.",
        ),
    ] = 2
    intake_time_limit: Annotated[
        float, Field(gt=0, le=DAY, description="Seconds in which an upload must be looked through, or is refused.")
    ] = 30.0
    max_attempts: Annotated[
        int, Field(ge=1, le=1000, description="How often a job is started, when workers die under it, before it fails.")
    ] = 2
    lease_seconds: Annotated[
        float, Field(ge=0.1, le=DAY, description="Silence after which a running job's worker counts as lost.")
    ] = 15.0
    job_time_limit: Annotated[float, Field(gt=0, le=30 * DAY, description="Seconds a job may run.")] = 600.0
    job_memory_limit: Annotated[
        int, Field(gt=0, le=MOST_BYTES, description="Resident bytes a job's process may hold.")
    ] = 8192 * MIB
    shutdown_seconds: Annotated[
        float,
        Field(
            ge=0,
            le=DAY,
            description="Seconds a worker that is told to stop goes on with its jobs, then gives them back.",
        ),
    ] = 5.0
    worker_concurrency: Annotated[int, Field(ge=1, le=1000, description="Jobs one worker runs at the same time.")] = 1
    sandbox: Annotated[
        str,
        Field(
            pattern="^(auto|required)$",
            description="`required`: no worker starts where the engine cannot be shut in; `auto`: as far as it can be.",
        ),
    ] = "auto"
    large_asset_bytes: Annotated[
        int,
        Field(
            gt=0,
            le=MOST_BYTES,
            description="Assets of so many bytes wait in the queue `large`, smaller ones in `small`.",
        ),
    ] = 20 * MIB
    gpu_asset_bytes: Annotated[
        int,
        Field(
            ge=0, le=MOST_BYTES, description="Assets of so many bytes wait in the queue `gpu`; 0: no worker has a GPU."
        ),
    ] = 0
    job_threads: Annotated[
        int,
        Field(
            ge=0,
            le=1000,
            description="Threads a job may use; 0: processors, of a container's limit, divided by worker_concurrency.",
        ),
    ] = 0
    retention_seconds: Annotated[
        float,
        Field(ge=0, le=100 * YEAR, description="Seconds after its end at which a job's files are deleted; 0: never."),
    ] = 0.0
    history_days: Annotated[
        int,
        Field(
            ge=0,
            le=36_500,
            description="Days after its end at which a job without results is forgotten, with all that is known of it; "
            "0: never.",
        ),
    ] = 90
    cache: Annotated[
        bool, Field(description="Answer an asset sent again with the same parameters with the results there are.")
    ] = True
    source_urls: Annotated[
        bool, Field(description="Let users give the address of an asset, `source_url`, in place of the asset.")
    ] = False
    outbound_networks: Annotated[
        tuple[IPv4Network | IPv6Network, ...],
        NoDecode,
        Field(description="Networks beside the public ones that users' addresses may lie in: `10.1.0.0/16,...`."),
    ] = ()
    outbound_ports: Annotated[
        frozenset[PortNumber],
        NoDecode,
        Field(min_length=1, description="Ports that users' addresses may have: `80,443,...`."),
    ] = PORTS
    outbound_http: Annotated[
        bool, Field(description="Let users give addresses that begin with `http://`, unencrypted.")
    ] = False
    secrets_key: Annotated[
        Path | None,
        Field(
            description="File of the keys that webhooks' secrets are encrypted with, one a line, for API and sender of "
            "webhooks; empty: in clear."
        ),
    ] = None
    c2pa_chain: Annotated[
        Path | None,
        Field(
            description="PEM file of the certificates that results are signed with, the signer's own first, for API, "
            "workers and signers; empty: results have no Content Credentials."
        ),
    ] = None
    c2pa_trust: Annotated[
        Path | None,
        Field(description="PEM file of the root certificates that verifications trust, for workers; empty: none."),
    ] = None
    c2pa_key: Annotated[
        Path | None,
        Field(description="PEM file of the private key (EC, P-256) of the first certificate, for signers alone."),
    ] = None
    c2pa_timestamp_url: Annotated[
        str,
        Field(
            pattern="^$|^https?://",
            description="Server of time stamps (RFC 3161) that signers send each signature to; empty: none.",
        ),
    ] = ""
    hooks_file: Annotated[
        Path | None, Field(description="TOML file of the buckets to watch, for API and workers; empty: none.")
    ] = None
    device: Annotated[
        str,
        Field(
            pattern="^(auto|cpu|cuda)$",
            description="Where placement is computed: `cpu`, `cuda`, or `auto` for CUDA where there is any.",
        ),
    ] = "auto"
    log_level: Annotated[str, Field(pattern="^(DEBUG|INFO|WARNING|ERROR)$", description="Least level logged.")] = "INFO"

    @field_validator("outbound_networks", mode="before")
    @classmethod
    def _networks(cls, listed: object) -> object:
        return tuple(map(ip_network, _split(listed))) if isinstance(listed, str) else listed

    @field_validator("outbound_ports", mode="before")
    @classmethod
    def _ports(cls, listed: object) -> object:
        return frozenset(_split(listed)) if isinstance(listed, str) else listed

    @field_validator("hooks_file")
    @classmethod
    def _can_be_watched(cls, path: Path | None) -> Path | None:
        if path:
            load_hooks(path)
        return path

    @field_validator("secrets_key")
    @classmethod
    def _has_keys(cls, path: Path | None) -> Path | None:
        read_keys(path)
        return path

    @field_validator("database_url")
    @classmethod
    def _can_be_parsed(cls, url: str) -> str:
        try:
            if url:
                make_url(url)
        except (ArgumentError, ValueError):
            raise ValueError("it is not a URL") from None  # the original's words may hold the password
        return url

    @field_validator("data_dir")
    @classmethod
    def _can_be_written(cls, folder: Path) -> Path:
        there = next(path for path in (folder.resolve(), *folder.resolve().parents) if path.exists())
        if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
            raise ValueError(f"{there} is not a folder that can be written to")
        return folder

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.auth == "none" and not _is_loopback(self.host):
            raise ValueError(
                f"MESHMARK_HOST={self.host} lets others in: set MESHMARK_AUTH=keys, "
                "and create keys with `python -m service keys create`"
            )
        if bool(self.s3_access_key_id.get_secret_value()) != bool(self.s3_secret_access_key.get_secret_value()):
            raise ValueError("MESHMARK_S3_ACCESS_KEY_ID and MESHMARK_S3_SECRET_ACCESS_KEY go together")
        if self.s3_presign and not self.store_url:
            raise ValueError("MESHMARK_S3_PRESIGN needs a MESHMARK_STORE_URL")
        if self.c2pa_chain is None and (self.c2pa_key or self.c2pa_timestamp_url):
            raise ValueError("MESHMARK_C2PA_KEY and MESHMARK_C2PA_TIMESTAMP_URL need a MESHMARK_C2PA_CHAIN")
        return self

    @property
    def budgets(self) -> Budgets:
        """Budgets of an asset: the sizes that it may declare."""
        return replace(
            DEFAULT_BUDGETS,
            bytes=self.max_upload_bytes,
            unpacked_bytes=self.max_unpacked_bytes,
            faces=self.max_faces,
            vertices=self.max_vertices,
            image_pixels=self.max_image_pixels,
        )

    @property
    def outbound(self) -> Policy:
        """Policy of requests to addresses that users name."""
        schemes = {"https", "http"} if self.outbound_http else {"https"}
        return Policy(self.outbound_networks, frozenset(schemes), self.outbound_ports)

    @cached_property
    def hooks(self) -> Mapping[str, HookSource]:
        """The buckets to watch, by the names of their hooks."""
        return load_hooks(self.hooks_file) if self.hooks_file else {}

    @property
    def ledger_url(self) -> str:
        """The SQLAlchemy URL in effect."""
        return self.database_url or f"sqlite:///{self.data_dir.resolve() / 'ledger.sqlite3'}"


def _split(listed: str) -> list[str]:
    return [item.strip() for item in listed.split(",") if item.strip()]


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:  # another name
        return False


def load_settings(secrets: Path = SECRETS) -> Settings:
    """The settings of this process: from the environment, or else from files `meshmark_<name>` among the secrets.

    Raises:
        SystemExit: with code 2, once every setting that cannot work is named in a line of its own on stderr.
    """
    try:
        return Settings(_secrets_dir=secrets if secrets.is_dir() else None)  # type: ignore[call-arg]
    except ValidationError as error:
        for problem in error.errors():
            message = problem["msg"].removeprefix("Value error, ")
            if problem["loc"]:
                name = str(problem["loc"][0])
                message = f"{PREFIX}{name.upper()}: {message}. {Settings.model_fields[name].description}"
            print(message, file=sys.stderr)
        sys.exit(2)
