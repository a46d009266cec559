"""Who is counted as one client without a key, through a real server."""

from pathlib import Path

import httpx2

from tests.service.edge import edge_with


def test_a_proxy_on_the_same_machine_says_whose_address_it_is(tmp_path: Path) -> None:
    with edge_with(data_dir=tmp_path, public_verification=True, public_verifications_per_minute=1) as edge:
        answers = [
            httpx2.post(
                f"http://127.0.0.1:{edge.port}/v1/verifications",
                files={"file": ("suspect.obj", b"")},
                headers={"X-Forwarded-For": address},
            )
            for address in ("192.0.2.1", "192.0.2.1", "192.0.2.2", "2001:db8::1", "2001:db8::2")
        ]
    assert [answer.status_code for answer in answers] == [422, 429, 422, 422, 429]
