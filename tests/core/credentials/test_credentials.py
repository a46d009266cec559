"""Content Credentials: signed with the library, read back by the library's own reader and by ours."""

import io
from collections.abc import Iterator
from contextlib import closing
from copy import deepcopy
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import c2pa
import pytest
from PIL import Image

from core.credentials.chain import Chain, UnusableChainError, read_chain, self_signed
from core.credentials.facts import CredentialState
from core.credentials.manifest import definition
from core.credentials.read import read_credentials
from core.credentials.sign import Signer
from core.errors import ErrorCode, MeshmarkError
from service.routes.report_example import REPORT

GLB = "model/gltf-binary"
MODEL = b"glTF, or any other bytes"
TODAY = datetime.now(UTC)
GENERATED = "http://cv.iptc.org/newscodes/digitalsourcetype/trainedAlgorithmicMedia"
BEGIN = b"-----BEGIN CERTIFICATE-----"


@pytest.fixture(scope="module")
def chain() -> Chain:
    return self_signed(TODAY)


@pytest.fixture(scope="module")
def signer(chain: Chain) -> Iterator[Signer]:
    with closing(Signer(chain)) as signer:
        yield signer


@pytest.fixture(scope="module")
def sidecar(signer: Signer) -> bytes:
    return signed(signer, MODEL)


def root_of(chain: Chain) -> str:
    return (BEGIN + chain.certificates.split(BEGIN)[2]).decode()


def report(**changes: Any) -> Any:
    return {**deepcopy(REPORT), **changes}


def signed(signer: Signer, model: bytes, of: Any = REPORT) -> bytes:
    return signer.sign(io.BytesIO(model), definition(of, "fox.glb", GLB), io.BytesIO())


def test_the_librarys_reader_finds_the_marks_by_name_and_place(sidecar: bytes, chain: Chain) -> None:
    trust = {"trust": {"user_anchors": root_of(chain)}, "verify": {"verify_trust": True}}
    with (
        c2pa.Context.from_dict(trust) as context,
        c2pa.Reader(GLB, io.BytesIO(MODEL), manifest_data=sidecar, context=context) as reader,
    ):
        assert reader.get_validation_state() == "Trusted"
        said = {one["label"]: one["data"] for one in reader.get_active_manifest()["assertions"]}
    mark = said["org.meshmark.marks"]["watermarks"][0]
    assert (mark["text"], mark["center"]) == ("SAMPLE", {"x": -0.3008, "y": 0.721, "z": -0.1633})
    assert said["org.meshmark.marks"]["model"]["sha256"] == REPORT["model"]["sha256"]  # type: ignore[index, call-overload]
    assert [action["action"] for action in said["c2pa.actions.v2"]["actions"]] == ["c2pa.opened", "c2pa.edited"]


def test_a_file_with_its_sidecar_is_trusted_where_the_root_is_and_valid_elsewhere(sidecar: bytes, chain: Chain) -> None:
    here = read_credentials(MODEL, GLB, sidecar, root_of(chain))
    assert (here.state, here.codes) == (CredentialState.TRUSTED, [])
    assert (here.generator, here.title, here.marks) == ("Meshmark 0.1.0", "fox.glb", ("SAMPLE",))
    elsewhere = read_credentials(MODEL, GLB, sidecar)
    assert elsewhere.state == CredentialState.VALID
    stranger = read_credentials(MODEL, GLB, sidecar, root_of(self_signed(TODAY)))
    assert (stranger.state, stranger.codes) == (CredentialState.VALID, ["signingCredential.untrusted"])


def test_one_other_byte_or_another_file_is_told(sidecar: bytes) -> None:
    for other in (b"G" + MODEL[1:], MODEL + b"\0", b"another file"):
        found = read_credentials(other, GLB, sidecar)
        assert found.state == CredentialState.TAMPERED
        assert "assertion.dataHash.mismatch" in found.codes


def test_a_changed_statement_is_told(sidecar: bytes) -> None:
    assert read_credentials(MODEL, GLB, sidecar.replace(b"SAMPLE", b"SIMPLE")).state == CredentialState.TAMPERED


@pytest.mark.parametrize("cut", [0, 1, 100, 1000, -1])
def test_a_manifest_that_is_not_whole_is_refused_in_words(sidecar: bytes, cut: int) -> None:
    with pytest.raises(MeshmarkError, match="credentials cannot be read") as caught:
        read_credentials(MODEL, GLB, sidecar[:cut])
    assert caught.value.code == ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize(
    "shaped", [[], "text", 7, None, {}, {"watermarks": {}}, {"watermarks": [1, None, [], {}, {"text": 5}]}]
)
def test_a_statement_of_another_shape_than_ours_is_no_fault_of_the_file(signer: Signer, shaped: Any) -> None:
    made = definition(REPORT, "fox.glb", GLB)
    made["assertions"][1]["data"] = shaped
    found = read_credentials(MODEL, GLB, signer.sign(io.BytesIO(MODEL), made, io.BytesIO()))
    assert found.state == CredentialState.VALID
    assert found.marks in ((), ("None", "5"))


def test_a_preview_model_is_told_by_its_own_hash_and_marks() -> None:
    light = {"sha256": "ab" * 32, "watermarks": [1]}
    two = [{**mark, "id": number} for number in (0, 1) for mark in report()["watermarks"][:1]]
    two[1]["text"] = "CARRIED"
    made = definition(report(preview_model=light, watermarks=two), "fox.preview.glb", GLB, preview=True)
    [said] = [one["data"] for one in made["assertions"] if one["label"] == "org.meshmark.marks"]
    assert said["model"] == {"sha256": "ab" * 32}
    assert [mark["text"] for mark in said["watermarks"]] == ["CARRIED"]


def test_a_file_without_credentials_has_none() -> None:
    picture = io.BytesIO()
    Image.new("RGB", (4, 4)).save(picture, "PNG")
    assert read_credentials(MODEL, GLB).state == CredentialState.ABSENT
    assert read_credentials(picture.getvalue(), "image/png").state == CredentialState.ABSENT


def test_a_declared_source_is_where_the_model_was_created() -> None:
    with closing(Signer(self_signed(TODAY))) as signer:
        sidecar = signed(signer, MODEL, report(label={"source_type": GENERATED}))
    found = read_credentials(MODEL, GLB, sidecar)
    assert (found.actions, found.source_type) == (("c2pa.created", "c2pa.edited"), GENERATED)


def test_metadata_alone_are_an_edit_of_metadata(signer: Signer) -> None:
    parameters = {**REPORT["parameters"], "metadata_only": True}  # type: ignore[dict-item]
    found = read_credentials(MODEL, GLB, signed(signer, MODEL, report(parameters=parameters, watermarks=[])))
    assert found.actions == ("c2pa.opened", "c2pa.edited.metadata")


def test_a_picture_carries_its_own(signer: Signer, chain: Chain) -> None:
    picture, copy = io.BytesIO(), io.BytesIO()
    Image.new("RGB", (64, 32), (200, 90, 10)).save(picture, "PNG")
    picture.seek(0)
    signer.sign(picture, definition(REPORT, "fox.png", "image/png"), copy, embed=True)
    assert read_credentials(copy.getvalue(), "image/png", anchors=root_of(chain)).state == CredentialState.TRUSTED
    with Image.open(copy) as shown:
        assert shown.convert("RGB").getpixel((3, 3)) == (200, 90, 10)


def test_the_key_is_not_in_what_is_signed(sidecar: bytes, chain: Chain) -> None:
    assert chain.key.splitlines()[1] not in sidecar


def test_a_chain_is_what_it_is_read_from(chain: Chain) -> None:
    again = read_chain(chain.certificates, chain.key, TODAY)
    assert again == chain


LATER, EARLIER = TODAY + timedelta(days=366), TODAY - timedelta(days=1)


@pytest.mark.parametrize(
    ("change", "moment", "said"),
    [
        (lambda one, other: (one.certificates, other.key), TODAY, "key is not that of the chain's first certificate"),
        (lambda one, _: (BEGIN + one.certificates.split(BEGIN)[1], one.key), TODAY, "issuer's must follow"),
        (
            lambda one, other: (BEGIN + one.certificates.split(BEGIN)[1] + root_of(other).encode(), one.key),
            TODAY,
            "is not signed by",
        ),
        (lambda one, _: (one.certificates, one.key), LATER, "expired on"),
        (lambda one, _: (one.certificates, one.key), EARLIER, "begins on"),
        (lambda one, _: (b"no certificates", one.key), TODAY, "holds no certificates"),
        (lambda one, _: (one.certificates, b"no key"), TODAY, "no private key in PEM"),
        (lambda one, _: (one.certificates, one.certificates), TODAY, "no private key in PEM"),
    ],
)
def test_a_chain_that_nothing_can_be_signed_with_is_refused_in_words(
    change: Any, moment: datetime, said: str, chain: Chain
) -> None:
    certificates, key = change(chain, self_signed(TODAY))
    with pytest.raises(UnusableChainError, match=said):
        read_chain(certificates, key, moment)


def test_a_certificate_that_is_out_of_date_is_told_from_another_file() -> None:
    sidecar = Path(__file__).with_name("expired.c2pa").read_bytes()  # signed a second before its certificate expired
    assert read_credentials(MODEL, GLB, sidecar).state == CredentialState.EXPIRED
    assert read_credentials(b"another file", GLB, sidecar).state == CredentialState.TAMPERED


def test_nothing_is_signed_with_a_certificate_that_is_out_of_date() -> None:
    with pytest.raises(UnusableChainError, match="not valid at time of signing"):
        Signer(self_signed(TODAY - timedelta(days=400)))
