import base64

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.gltf.data_uri import decode_data_uri, is_data_uri


@given(
    data=st.binary(max_size=60),
    padded=st.booleans(),
    url_safe=st.booleans(),
    every=st.integers(1, 80),
    blank=st.sampled_from(["", " ", "\n", "\r\n", "\t", "%0A"]),
    header=st.sampled_from(
        ["data:", "data:image/png", "data:text/plain;charset=utf-8", "DATA:application/octet-stream"]
    ),
    escaped=st.booleans(),
)
def test_base64_is_read_in_every_spelling(
    data: bytes, padded: bool, url_safe: bool, every: int, blank: str, header: str, escaped: bool
) -> None:
    text = (base64.urlsafe_b64encode if url_safe else base64.b64encode)(data).decode()
    text = text if padded else text.rstrip("=")
    if escaped:
        text = text.replace("+", "%2B").replace("/", "%2F").replace("=", "%3D")
    elif "%" not in blank:
        text = blank.join(text[at : at + every] for at in range(0, len(text), every))
    uri = f"{header};base64,{text}"
    assert is_data_uri(uri)
    assert decode_data_uri(uri) == data


@given(data=st.binary(max_size=60))
def test_percent_encoding_is_read(data: bytes) -> None:
    assert decode_data_uri("data:application/octet-stream," + "".join(f"%{byte:02x}" for byte in data)) == data


@given(text=st.text(max_size=60))
def test_any_text_is_bytes_or_a_value_error(text: str) -> None:
    for uri in (text, "data:" + text, "data:;base64," + text):
        try:
            assert isinstance(decode_data_uri(uri), bytes)
        except ValueError:
            assert "," not in uri or "base64" in uri


@pytest.mark.parametrize("uri", [None, 7, "", "mesh.bin", "http://example.org/data:", "database.bin"])
def test_other_uris_are_no_data(uri: object) -> None:
    assert not is_data_uri(uri)
