"""Content Credentials of a file, read back and judged with c2pa, an extra."""

import io
import json
from typing import Any

import c2pa
from cryptography.x509 import load_pem_x509_certificates

from core.credentials.facts import ABSENT, LONGEST_SIDECAR, Credentials, CredentialState
from core.credentials.manifest import MARKS
from core.errors import ErrorCode, MeshmarkError

OUT_OF_DATE = {"signingCredential.expired", "claimSignature.outsideValidity"}
UNTRUSTED = "signingCredential.untrusted"


def read_credentials(
    data: bytes, media_type: str, sidecar: bytes | None = None, anchors: str | None = None
) -> Credentials:
    """Credentials of a file: those of a sidecar, or of the file itself where its format can hold them.

    Args:
        data: the file.
        media_type: of the file.
        sidecar: a manifest store that came beside it.
        anchors: PEM of the root certificates that are trusted.

    Raises:
        MeshmarkError: ``malformed_file``, ``budget_exceeded``: the sidecar cannot be read, or is far too large;
            ``invalid_parameters``: there are no certificates among the anchors.
    """
    if sidecar is not None and len(sidecar) > LONGEST_SIDECAR:
        raise MeshmarkError(
            ErrorCode.BUDGET_EXCEEDED,
            f"The credentials have {len(sidecar):,} bytes; {LONGEST_SIDECAR:,} are read at most.",
            "Send the manifest store alone, as GET /v1/watermarks/{id}/credentials gives it.",
        )
    if anchors is not None:
        _require_certificates(anchors)
    settings: dict[str, Any] = {"verify": {"remote_manifest_fetch": False, "verify_trust": anchors is not None}}
    if anchors is not None:
        settings["trust"] = {"user_anchors": anchors}
    if sidecar == b"":
        raise _unreadable("it is empty")
    try:
        with c2pa.Context.from_dict(settings) as context:
            reader = c2pa.Reader(media_type, io.BytesIO(data), manifest_data=sidecar, context=context)
            return _judged(json.loads(reader.json()))
    except c2pa.C2paError.ManifestNotFound:
        return ABSENT
    except c2pa.C2paError as error:
        if sidecar is None and isinstance(error, c2pa.C2paError.NotSupported):
            return ABSENT  # the format holds none
        raise _unreadable(" ".join(str(error).split())) from None


def _require_certificates(anchors: str) -> None:
    try:
        load_pem_x509_certificates(anchors.encode())
    except ValueError:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            "The trusted root certificates are no certificates in PEM.",
            "Name a PEM file of the root certificates that you trust.",
        ) from None


def _judged(store: dict[str, Any]) -> Credentials:
    manifest = store["manifests"][store["active_manifest"]]
    results = store["validation_results"]["activeManifest"]
    codes = sorted({failure["code"] for failure in results["failure"]})
    signature = manifest.get("signature_info") or {}
    generators = manifest.get("claim_generator_info") or [{}]
    said = {one["label"]: one.get("data") for one in manifest.get("assertions", [])}
    actions = [*_items(said.get("c2pa.actions.v2"), "actions"), *_items(said.get("c2pa.actions"), "actions")]
    sources = filter(None, (action.get("digitalSourceType") for action in actions))
    return Credentials(
        state=_state(store["validation_state"], codes),
        codes=codes,
        issuer=signature.get("issuer"),
        name=signature.get("common_name"),
        time=signature.get("time"),
        generator=" ".join(filter(None, [generators[0].get("name"), generators[0].get("version")])) or None,
        title=manifest.get("title"),
        source_type=next(map(str, sources), None),
        actions=tuple(str(action.get("action")) for action in actions),
        marks=tuple(str(mark.get("text")) for mark in _items(said.get(MARKS), "watermarks")),
    )


def _items(data: Any, name: str) -> list[dict[str, Any]]:
    """The objects of a list in an assertion, which whoever signs it may shape as they like."""
    items = data.get(name) if isinstance(data, dict) else None
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


def _state(said: str, codes: list[str]) -> CredentialState:
    match said:
        case "Trusted":
            return CredentialState.TRUSTED
        case "Valid":
            return CredentialState.VALID
    late = OUT_OF_DATE & set(codes) and not set(codes) - OUT_OF_DATE - {UNTRUSTED}
    return CredentialState.EXPIRED if late else CredentialState.TAMPERED


def _unreadable(trouble: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.MALFORMED_FILE,
        f"The credentials cannot be read: {trouble}.",
        "Send the manifest store (application/c2pa) as it was downloaded, whole.",
    )
