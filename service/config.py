"""Settings: every one is an environment variable `MESHMARK_<NAME>`."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from core.asset.budgets import DEFAULT_BUDGETS, Budgets
from core.lettering.fonts import MAX_FONT_BYTES

MIB = 2**20


class Settings(BaseSettings):
    """What the API, the worker and the embedded service read at start."""

    model_config = SettingsConfigDict(env_prefix="MESHMARK_", extra="ignore")

    host: Annotated[str, Field(description="Address the API listens on.")] = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535, description="Port the API listens on; 0 takes any free one.")] = 8080
    data_dir: Annotated[
        Path, Field(description="Folder of artifacts, scratch files, and of the default ledger and broker.")
    ] = Path("data")
    database_url: Annotated[
        str,
        Field(
            pattern=r"^$|^(sqlite|postgresql)\b",
            description="SQLAlchemy URL of the job ledger (SQLite, PostgreSQL); empty: SQLite in data_dir.",
        ),
    ] = ""
    broker_url: Annotated[
        str,
        Field(
            pattern=r"^(filesystem|rediss?)://",
            description="Queue: `redis://...`, or `filesystem://` for files in data_dir and no server.",
        ),
    ] = "filesystem://"
    max_upload_bytes: Annotated[int, Field(gt=0, description="Largest asset accepted, in bytes.")] = (
        DEFAULT_BUDGETS.bytes
    )
    max_unpacked_bytes: Annotated[
        int, Field(gt=0, description="Largest content of an archive accepted, unpacked, in bytes.")
    ] = DEFAULT_BUDGETS.unpacked_bytes
    max_faces: Annotated[int, Field(gt=0, description="Most triangles an asset may draw.")] = DEFAULT_BUDGETS.faces
    max_vertices: Annotated[int, Field(gt=0, description="Most vertices an asset may draw.")] = DEFAULT_BUDGETS.vertices
    max_image_pixels: Annotated[
        int, Field(gt=0, description="Most pixels all textures of an asset may have together.")
    ] = DEFAULT_BUDGETS.image_pixels
    max_font_bytes: Annotated[int, Field(gt=0, le=MAX_FONT_BYTES, description="Largest font accepted, in bytes.")] = (
        MAX_FONT_BYTES
    )
    max_attempts: Annotated[
        int, Field(ge=1, description="How often a job is started, when workers die under it, before it fails.")
    ] = 2
    lease_seconds: Annotated[
        float, Field(gt=0, description="Silence after which a running job's worker counts as lost.")
    ] = 15.0
    job_time_limit: Annotated[float, Field(gt=0, description="Seconds a job may run.")] = 600.0
    job_memory_limit: Annotated[int, Field(gt=0, description="Resident bytes a job's process may hold.")] = 8192 * MIB
    worker_concurrency: Annotated[int, Field(ge=1, description="Jobs one worker runs at the same time.")] = 1
    job_threads: Annotated[
        int, Field(ge=0, description="Threads a job may use; 0: the machine's cores divided by worker_concurrency.")
    ] = 0
    device: Annotated[
        str,
        Field(
            pattern="^(auto|cpu|cuda)$",
            description="Where placement is computed: `cpu`, `cuda`, or `auto` for CUDA where there is any.",
        ),
    ] = "auto"
    log_level: Annotated[str, Field(pattern="^(DEBUG|INFO|WARNING|ERROR)$", description="Least level logged.")] = "INFO"

    @property
    def budgets(self) -> Budgets:
        """What an asset may declare."""
        return replace(
            DEFAULT_BUDGETS,
            bytes=self.max_upload_bytes,
            unpacked_bytes=self.max_unpacked_bytes,
            faces=self.max_faces,
            vertices=self.max_vertices,
            image_pixels=self.max_image_pixels,
        )

    @property
    def ledger_url(self) -> str:
        """The SQLAlchemy URL in effect."""
        return self.database_url or f"sqlite:///{self.data_dir.resolve() / 'ledger.sqlite3'}"
