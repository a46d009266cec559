"""`meshmark verify` judges the Content Credentials that come with a file."""

import io
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.cli import main
from core.credentials.chain import self_signed
from core.credentials.manifest import definition
from core.credentials.sign import Signer
from core.errors import ErrorCode, MeshmarkError
from core.verify import seal
from core.verify.seal import Seal, judge
from core.verify.verify import verify
from service.routes.report_example import REPORT

CHAIN = self_signed(datetime.now(UTC))
ROOTS = CHAIN.certificates.decode()


def picture(signed: bool = True) -> bytes:
    plain, copy = io.BytesIO(), io.BytesIO()
    Image.fromarray(np.full((64, 96, 3), 128, np.uint8)).save(plain, "PNG")
    if not signed:
        return plain.getvalue()
    plain.seek(0)
    with closing(Signer(CHAIN)) as signer:
        signer.sign(plain, definition(REPORT, "spot.png", "image/png"), copy, embed=True)
    return copy.getvalue()


def sidecar_of(model: bytes) -> bytes:
    with closing(Signer(CHAIN)) as signer:
        return signer.sign(io.BytesIO(model), definition(REPORT, "spot.glb", "model/gltf-binary"), io.BytesIO())


@pytest.mark.parametrize("model", [b"glTF...", b"solid stl", b"an OBJ"])
def test_a_sidecar_fits_the_very_bytes_of_a_model_of_any_format(model: bytes) -> None:
    found = judge(model, None, Seal(sidecar_of(model), ROOTS))
    other = judge(model + b" ", None, Seal(sidecar_of(model), ROOTS))
    assert found is not None
    assert other is not None
    assert (found.state, other.state) == ("trusted", "tampered")


def test_a_picture_is_judged_by_its_own() -> None:
    report = verify(picture()).report
    assert report["credentials"]["state"] == "valid"
    assert report["credentials"]["actions"] == ["c2pa.opened", "c2pa.edited"]
    assert verify(picture(), seal=Seal(anchors=ROOTS)).report["credentials"]["state"] == "trusted"
    assert verify(picture(signed=False)).report["credentials"]["state"] == "absent"


def test_where_the_library_is_missing_nothing_is_claimed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seal, "find_spec", lambda _: None)
    assert verify(picture()).report["credentials"] is None
    with pytest.raises(MeshmarkError, match="extra c2pa is not installed") as caught:
        judge(b"glTF", None, Seal(b"sidecar"))
    assert caught.value.code == ErrorCode.UNSUPPORTED_FEATURE


def test_the_command_takes_a_sidecar_and_roots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {"p.png": picture(signed=False), "p.c2pa": sidecar_of(picture(signed=False)), "roots.pem": ROOTS.encode()}
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    command = ["verify", str(tmp_path / "p.png"), "--credentials", str(tmp_path / "p.c2pa")]
    assert main([*command, "--trust", str(tmp_path / "roots.pem")]) == 0
    assert "credentials: trusted, signed by Meshmark self-signed, signer for tests" in capsys.readouterr().out
    (tmp_path / "p.c2pa").write_bytes(files["p.c2pa"][:500])
    assert main(command) == 65
    assert "The credentials cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize(
    "roots", ["", "no certificates", "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----"]
)
def test_roots_that_are_none_are_refused(roots: str) -> None:
    with pytest.raises(MeshmarkError, match="root certificates") as caught:
        judge(b"glTF", None, Seal(sidecar_of(b"glTF"), roots))
    assert caught.value.code == ErrorCode.INVALID_PARAMETERS
