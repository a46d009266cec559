import os
import subprocess
import sys
from base64 import urlsafe_b64encode
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from cryptography.fernet import Fernet
from sqlalchemy import select, update

from service.config import Settings
from service.jobs.clock import now
from service.jobs.events import ENDINGS
from service.jobs.ledger import Ledger
from service.jobs.models import WebhookDelivery, WebhookEndpoint
from service.jobs.queue import create_queue
from service.webhooks.endpoints import create_endpoint, find_endpoint, rotate_secret
from service.webhooks.signing import new_secret
from service.webhooks.vault import UnreadableSecretError, Vault, read_keys, renew_secrets
from tests.service.conftest import client_with
from tests.service.harness import free_port
from tests.service.webhooks.receiver import Receiver
from tests.worker.waiting import PATIENCE
from worker.tasks import private_folders
from worker.webhooks import Sender, sweep

OLD, NEW = (urlsafe_b64encode(bytes([number]) * 32).decode() for number in (1, 2))
TENANT, URL = "default", "https://shop.example/"


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    with closing(Ledger(database_url)) as ledger:
        yield ledger


def vault(*keys: str) -> Vault:
    return Vault([*map(Fernet, keys)])


def key_file(folder: Path, *keys: str) -> Path:
    path = folder / "secrets-key"
    path.write_text("\n".join(keys) + "\n")
    return path


def stored(ledger: Ledger) -> set[str]:
    with ledger.sessions() as session:
        rows = session.scalars(select(WebhookEndpoint)).all()
        return {text for row in rows for text in (row.secret, row.former_secret) if text}


def test_with_a_key_no_secret_is_found_in_the_ledger_and_all_of_them_are_read(ledger: Ledger) -> None:
    longest = "whsec_" + "QUJD" * 21  # 63 bytes; 64 are the most
    made = create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, longest, vault(OLD))
    rotated = rotate_secret(ledger.sessions, TENANT, made.id, None, vault(OLD))
    assert not [text for text in stored(ledger) if "whsec" in text or "QUJD" in text]
    assert len(stored(ledger)) == 2
    assert vault(OLD).unseal(rotated.former_secret or "") == longest
    assert vault(NEW, OLD).unseal(rotated.secret).startswith("whsec_")
    for wrong in (vault(NEW), vault()):
        with pytest.raises(UnreadableSecretError):
            wrong.unseal(rotated.secret)


def test_what_stands_in_clear_or_under_an_old_key_is_encrypted_with_the_first(ledger: Ledger) -> None:
    secrets = [new_secret() for _ in range(3)]
    first = create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, secrets[0])
    rotate_secret(ledger.sessions, TENANT, first.id, secrets[1])
    create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, secrets[2])
    renew_secrets(ledger.sessions, vault())
    assert stored(ledger) == set(secrets)
    for keys in ((OLD,), (OLD, NEW), (NEW, OLD), (NEW,)):  # a rotation
        renew_secrets(ledger.sessions, vault(*keys))
        assert {vault(keys[0]).unseal(text) for text in stored(ledger)} == set(secrets)
    before = stored(ledger)
    renew_secrets(ledger.sessions, vault(NEW))
    assert stored(ledger) == before, "what is as it should be is not written again"
    for wrong in (vault(OLD), vault()):
        with pytest.raises(UnreadableSecretError, match=r"^The secret of the webhook endpoint [0-9a-f-]+ is encrypted"):
            renew_secrets(ledger.sessions, wrong)


@pytest.mark.parametrize("content", ["", "\n", "short\n", f"{OLD}\nnot a key", "whsec_" + "A" * 43, b"\xff\xfe"])
def test_a_file_that_is_none_of_keys_is_refused_at_start_and_not_shown(content: str | bytes, tmp_path: Path) -> None:
    path = tmp_path / "secrets-key"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ValueError, match="secrets_key") as refused:
        Settings(secrets_key=path)
    assert OLD not in str(refused.value)
    with pytest.raises(ValueError, match="cannot be read"):
        read_keys(tmp_path / "none")


def test_a_client_gets_the_secret_that_signs(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", secrets_key=key_file(tmp_path, OLD))
    assert settings.secrets_key in private_folders(settings), "the engine's process does not see the keys"
    with client_with(settings) as client:
        mine = new_secret()
        made = client.http.post("/v1/webhook-endpoints", json={"url": URL, "secret": mine})
        assert made.json()["secret"] == mine
        rotated = client.http.post(f"{made.headers['Location']}/rotate-secret").json()["secret"]
        row = find_endpoint(client.worker.ledger.sessions, TENANT, made.json()["id"])
        assert [vault(OLD).unseal(text or "") for text in (row.secret, row.former_secret)] == [rotated, mine]


@pytest.mark.parametrize("command", [["service", "api"], ["worker.webhooks"]])
@pytest.mark.parametrize("key", [NEW, None])
def test_a_wrong_key_is_told_at_start(command: list[str], key: str | None, tmp_path: Path) -> None:
    with closing(Ledger(Settings(data_dir=tmp_path).ledger_url)) as ledger:
        create_endpoint(ledger.sessions, TENANT, URL, ENDINGS, None, vault(OLD))
    variables = {"MESHMARK_DATA_DIR": os.fspath(tmp_path)}
    if key:
        variables["MESHMARK_SECRETS_KEY"] = os.fspath(key_file(tmp_path, key))
    ended = subprocess.run(
        [sys.executable, "-m", *command],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.splitlines()[-1].startswith("The secret of the webhook endpoint ")
    assert "Traceback" not in ended.stderr


def test_what_cannot_be_signed_is_not_sent_and_does_not_count_until_the_key_is_there(tmp_path: Path) -> None:
    receiver = Receiver(free_port(), secret=new_secret())
    outbound = {"outbound_networks": "127.0.0.0/8", "outbound_http": True, "outbound_ports": str(receiver.port)}
    settings = Settings(data_dir=tmp_path, **outbound)  # type: ignore[arg-type]
    with create_queue(settings) as broker, receiver.running():
        sender = Sender(settings, broker)
        sessions = sender.ledger.sessions
        create_endpoint(sessions, TENANT, receiver.url, ENDINGS, receiver.secret, vault(OLD))
        sender.ledger.cancel(sender.ledger.create("asset.glb", {}, {}, lambda _: True).id)
        sweep(sender, lost=False)
        with sessions() as session:
            delivery_id = session.scalars(select(WebhookDelivery.id)).one()
        sender.send(delivery_id)
        with sessions.begin() as session:
            delivery = session.get_one(WebhookDelivery, delivery_id)
            assert (delivery.state, delivery.attempts, delivery.log) == ("pending", 0, [])
            session.execute(update(WebhookDelivery).values(due_at=now()))
        assert receiver.ids == []
        sender.vault = vault(NEW, OLD)
        sender.send(delivery_id)
        assert len(receiver.believed) == 1
        sender.ledger.close()
