"""`python -m worker.signer [PID]`: signs the Content Credentials of results; given a process, it ends with it.

A process of its own, since it holds the key: it reads no file of a client, only what the engine made, and of the model
nothing but its bytes. It is also the one that calls a server of time stamps.
"""

import io
import json
import signal
import sys
import threading
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, BinaryIO

import structlog

try:
    from core.credentials.chain import UnusableChainError
    from core.credentials.sign import Signer, SigningError, UnsignableError
except ModuleNotFoundError as error:
    raise SystemExit(f"Signing takes the extra meshmark[c2pa]: {error}.") from None
from core.credentials.manifest import definition
from core.errors import ErrorCode, MeshmarkError
from service.config import Settings, load_settings
from service.correlation import on_behalf_of
from service.credentials import require_chain
from service.data_folder import keep_private
from service.hangup import hangup_handler
from service.jobs import contents, signing
from service.jobs.artifacts import ArtifactStore
from service.jobs.ledger import Ledger
from service.jobs.models import Artifact, ArtifactKind, Job
from service.jobs.stores import open_store
from service.logs import configure_logs
from service.metrics import CREDENTIALS, metrics_server
from service.stores import require_own_store
from worker.child import die_with_parent
from worker.repeating import repeatedly

INTERVAL = 0.25  # seconds between two queries for results
LARGEST_REPORT = 2**26  # bytes
LARGEST_MANIFEST = 2**24  # bytes
MODEL = "model/gltf-binary"
PICTURES = {  # ending and media type of those that carry a manifest of their own
    ArtifactKind.PREVIEW: (".png", "image/png"),
    ArtifactKind.TURNTABLE: (".turntable.webp", "image/webp"),
    ArtifactKind.POSTER: (".poster.webp", "image/webp"),
}
MODELS = {  # ending, and the manifest that lies beside it
    ArtifactKind.PREVIEW_MODEL: (".preview.glb", ArtifactKind.PREVIEW_MANIFEST),
    ArtifactKind.MODEL: (".glb", ArtifactKind.CREDENTIALS),
}

log = structlog.get_logger(__name__)


@dataclass
class SignerProcess:
    """Shared state of a signer process."""

    settings: Settings
    signer: Signer
    stopping: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.ledger = Ledger(self.settings.ledger_url, self.settings.retention_seconds)
        self.artifacts: ArtifactStore = open_store(self.settings)

    def sign_due(self) -> None:
        """Sign the results of all jobs that wait."""
        while not self.stopping.is_set() and (job := signing.take_due(self.ledger.sessions)):
            with on_behalf_of(job.correlation), structlog.contextvars.bound_contextvars(job=job.id):
                self._sign(job)

    def _sign(self, job: Job) -> None:
        try:
            self._publish_all(job)
        except SigningError as error:
            CREDENTIALS.labels("failed").inc()
            signing.postpone(self.ledger.sessions, job)
            log.error("a result could not be signed; trying again", reason=str(error))
        except FileNotFoundError:
            log.info("a result was deleted before it was signed")
        except UnsignableError as error:
            self.artifacts.ping()  # a full disk is an outage
            self.ledger.fail(job.lease, UNSIGNABLE)
            log.error("a result that cannot be signed", reason=str(error))
        else:
            if self.ledger.succeed(job.lease):
                CREDENTIALS.labels("signed").inc()
                log.info("job succeeded")

    def _publish_all(self, job: Job) -> None:
        report = self._report(job)
        stem = PurePath(job.filename).stem + ".watermarked"
        for kind, (ending, media_type) in PICTURES.items():
            if picture := job.artifact(kind):
                with self.artifacts.spool() as signed:
                    self._signed(picture, _defined(report, stem + ending, media_type), signed, embed=True)
                    signed.seek(0)
                    self._publish(job, kind, signed, 2 * picture.size + LARGEST_MANIFEST)
        _there(job, ArtifactKind.MODEL)
        for kind, (ending, beside) in MODELS.items():
            if model := job.artifact(kind):
                defined = _defined(report, stem + ending, MODEL, preview=kind is ArtifactKind.PREVIEW_MODEL)
                with self.artifacts.spool() as copy:
                    manifest = self._signed(model, defined, copy, embed=False)
                self._publish(job, beside, io.BytesIO(manifest), LARGEST_MANIFEST)

    def _report(self, job: Job) -> Any:
        artifact = _there(job, ArtifactKind.REPORT)
        with self.artifacts.fetched(artifact.sha256, artifact.size) as path, path.open("rb") as file:
            content = file.read(LARGEST_REPORT)
        try:
            return json.loads(content)
        except (ValueError, RecursionError):
            raise UnsignableError("its report is no report") from None

    def _signed(self, artifact: Artifact, definition: dict[str, Any], copy: BinaryIO, embed: bool) -> bytes:
        with self.artifacts.fetched(artifact.sha256, artifact.size) as path, path.open("rb") as file:
            return self.signer.sign(file, definition, copy, embed)

    def _publish(self, job: Job, kind: ArtifactKind, content: BinaryIO, limit: int) -> None:
        with self.artifacts.stage(content, limit=limit, name=kind) as staged:
            contents.publish(self.ledger, self.artifacts, job.lease, kind, staged)  # not recorded for an ended job


def _there(job: Job, kind: ArtifactKind) -> Artifact:
    if artifact := job.artifact(kind):
        return artifact
    raise FileNotFoundError(kind)


def _defined(report: Any, title: str, media_type: str, preview: bool = False) -> dict[str, Any]:
    """Definition of a manifest by a report that the engine's process wrote, which has read a hostile file."""
    try:
        return definition(report, title, media_type, preview=preview)
    except (LookupError, TypeError, ValueError, AttributeError):
        raise UnsignableError("its report is no report") from None


UNSIGNABLE = MeshmarkError(
    ErrorCode.INTERNAL_ERROR,
    "The results of this job cannot be signed.",
    "Report this job's id to the operator; the log holds the details.",
)


def main(parent: int | None) -> None:
    """Sign results until a signal ends it or its parent, where one is given, is gone."""
    if parent is not None:
        die_with_parent(parent)
    settings = load_settings()
    keep_private(settings)
    configure_logs(settings.log_level)
    chain = require_chain(settings)
    try:
        signer = Signer(chain, settings.c2pa_timestamp_url or None)
    except UnusableChainError as error:
        sys.exit(_failed(f"Content Credentials: {error}"))
    require_own_store(settings)
    process = SignerProcess(settings, signer)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: process.stopping.set())
    signal.signal(signal.SIGHUP, hangup_handler())
    with closing(signer), metrics_server(settings.metrics_host, settings.signer_metrics_port):
        log.info("ready", until=chain.expires.isoformat())
        thread = repeatedly("signer", process.sign_due, INTERVAL, process.stopping)
        while thread.is_alive():
            thread.join(INTERVAL)  # not for ever: a signal that comes as that begins would not be noticed
        process.ledger.close()
    log.info("stopped")


def _failed(sentence: str) -> int:
    print(sentence, file=sys.stderr)
    return 2


if __name__ == "__main__":
    main(int(sys.argv[1]) if sys.argv[1:] else None)
