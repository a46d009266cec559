"""Signing of Content Credentials with c2pa, an extra: beside a model, and within a picture."""

import io
import json
from collections.abc import Mapping
from contextlib import closing
from typing import Any, BinaryIO

import c2pa

from core.credentials.chain import Chain, UnusableChainError

ALGORITHM = b"es256"  # ECDSA with SHA-256 over P-256
SETTINGS = {"builder": {"thumbnail": {"enabled": False}}, "verify": {"remote_manifest_fetch": False}}

TRIAL = {
    "claim_generator_info": [{"name": "Meshmark"}],
    "format": "application/octet-stream",
    "assertions": [
        {
            "label": "c2pa.actions.v2",
            "data": {
                "actions": [{"action": "c2pa.created", "digitalSourceType": "http://c2pa.org/digitalsourcetype/empty"}]
            },
        }
    ],
}


class SigningError(Exception):
    """Nothing was signed this time, for example since the server of time stamps does not answer."""


class UnsignableError(Exception):
    """An asset or a definition that nobody could sign, or a disk that the copy does not fit on."""


class Signer:
    """Signer with one key, which never leaves it. Not to be shared between threads.

    Args:
        chain: key and certificates.
        timestamp_url: RFC 3161 server that every signature is sent to; None: signatures say no time.

    Raises:
        UnusableChainError: the library refuses the chain.
    """

    def __init__(self, chain: Chain, timestamp_url: str | None = None) -> None:
        self._context = c2pa.Context.from_dict(SETTINGS)
        try:
            self._signer = _signer(chain, timestamp_url)
            with closing(_signer(chain, None)) as trial:  # some faults show when something is signed, not before
                _sign(trial, self._context, TRIAL, io.BytesIO(b"trial"), io.BytesIO(), embed=False)
        except (c2pa.C2paError, SigningError, UnsignableError) as error:
            raise UnusableChainError(f"Nothing can be signed with the key and the chain: {_line(error)}.") from None

    def sign(self, asset: BinaryIO, definition: Mapping[str, Any], copy: BinaryIO, embed: bool = False) -> bytes:
        """A manifest store about an asset; it is beside the asset, or within a copy of it.

        Args:
            asset: open for reading.
            definition: of the manifest.
            copy: of the asset, open for reading and writing; with the manifest, where that is to be embedded.
            embed: embed it, in a format that has room for one.

        Raises:
            SigningError: nothing was signed this time.
            UnsignableError: nor would another time.
        """
        return _sign(self._signer, self._context, definition, asset, copy, embed)

    def close(self) -> None:
        """Forget the key."""
        self._signer.close()
        self._context.close()


def _signer(chain: Chain, timestamp_url: str | None) -> c2pa.Signer:
    return c2pa.Signer.from_info(c2pa.C2paSignerInfo(ALGORITHM, chain.certificates, chain.key, timestamp_url))


def _sign(
    signer: c2pa.Signer,
    context: c2pa.Context,
    definition: Mapping[str, Any],
    asset: BinaryIO,
    copy: BinaryIO,
    embed: bool,
) -> bytes:
    try:
        builder = c2pa.Builder.from_json(json.dumps(definition), context)
        if not embed:
            builder.set_no_embed()
        return bytes(builder.sign(signer, definition["format"], asset, copy))
    except c2pa.C2paError.Signature as error:
        raise SigningError(_line(error)) from error
    except c2pa.C2paError as error:
        raise UnsignableError(_line(error)) from error


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
