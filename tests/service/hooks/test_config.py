import subprocess
import sys
from pathlib import Path

import pytest

from core.formats.format import Format
from service.config import Settings
from service.hooks.config import load_hooks
from tests.worker.waiting import PATIENCE

EXAMPLE = Path(__file__).parents[3] / "docker" / "hooks.example.toml"
TOKEN = "0123456789abcdef"
SHOP = f"""
[sources.shop]
kind = "s3"
token = "{TOKEN}"
bucket = "assets"
input_prefix = "incoming/"
output_prefix = "watermarked/"
parameters = {{ text = "HI" }}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "hooks.toml"
    path.write_text(text)
    return path


def test_the_example_can_be_used_as_it_is() -> None:
    hooks = load_hooks(EXAMPLE)
    assert set(hooks) == {"shop", "aws", "events"}
    assert hooks["shop"].parameters.color == "#d02020"
    assert ".3mf" in hooks["aws"].suffixes
    assert hooks["shop"].output_key("incoming/a/chair.glb", ".report.json") == "watermarked/a/chair.glb.report.json"


def test_files_of_every_format_are_fetched_where_none_are_named(tmp_path: Path) -> None:
    (hook,) = load_hooks(written(tmp_path, SHOP)).values()
    assert set(hook.suffixes) == {*(each.ending for each in Format), ".zip"}


def test_settings_have_the_hooks_of_their_file(tmp_path: Path) -> None:
    assert Settings().hooks == {}
    assert Settings(hooks_file=written(tmp_path, SHOP)).hooks["shop"].tenant == "default"


def test_a_secret_may_stand_in_a_file_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "token").write_text(f"{TOKEN}-in-a-file\n")
    hook = load_hooks(written(tmp_path, SHOP.replace(f'token = "{TOKEN}"', f'token_file = "{tmp_path}/token"')))["shop"]
    assert hook.token is not None
    assert hook.token.get_secret_value() == f"{TOKEN}-in-a-file"


def changed(old: str, new: str) -> str:
    assert old in SHOP
    return SHOP.replace(old, new)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "sources"),
        ("[sources]", "sources"),
        ("no toml", "no TOML"),
        (changed('"watermarked/"', '"incoming/done/"'), "would be read by shop"),
        (changed('"incoming/"', '"watermarked/new/"'), "would be read by shop"),
        (changed('"watermarked/"', '"incoming/"'), "would be read by shop"),
        (changed('"incoming/"', '""'), "input_prefix"),
        (changed('"incoming/"', '"incoming"'), "input_prefix"),
        (SHOP + changed('"watermarked/"', '"other/"').replace("shop", "Shop"), "Shop"),
        (changed(f'token = "{TOKEN}"', ""), "token"),
        (changed(TOKEN, "short"), "16 characters"),
        (changed("kind", f'hmac_secret = "{TOKEN}"\nkind'), "either"),
        (changed(f'token = "{TOKEN}"', 'token_file = "/nowhere/token"'), "token_file"),
        (changed('"s3"', '"ftp"'), "kind"),
        (changed("kind", 'origins = ["events.example"]\nkind'), "CloudEvents"),
        (changed('kind = "s3"', 'kind = "cloudevents"\norigins = ["*"]'), "origins"),
        (changed("kind", 'access_key_id = "a"\nkind'), "go together"),
        (changed('text = "HI"', 'txt = "HI"'), "txt"),
        (changed('text = "HI"', 'text = ""'), "empty"),
        (changed('text = "HI"', 'text = "HI", logo = "logo.svg"'), "logo: .* use `qr`"),
        (changed('text = "HI"', 'text = "HI", logo_position = "above"'), "logo_position.* use `qr`"),
        (changed('text = "HI"', 'qr = "https://a.example", size = 1'), "too small to be read"),
        (changed("bucket", "buckets"), "buckets"),
    ],
)
def test_what_cannot_work_is_refused(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says) as caught:
        load_hooks(written(tmp_path, text))
    assert TOKEN not in str(caught.value)


def test_one_hook_must_not_feed_another(tmp_path: Path) -> None:
    second = SHOP.replace("shop", "second").replace('"incoming/"', '"watermarked/"', 1)
    second = second.replace('output_prefix = "watermarked/"', 'output_prefix = "done/"')
    with pytest.raises(ValueError, match="would be read by second"):
        load_hooks(written(tmp_path, SHOP + second))
    slashed = second.replace("bucket", 'endpoint = "http://minio:9000/"\nbucket')
    with pytest.raises(ValueError, match="would be read by second"):
        load_hooks(written(tmp_path, SHOP.replace("bucket", 'endpoint = "http://minio:9000"\nbucket') + slashed))
    elsewhere = second.replace('bucket = "assets"', 'bucket = "others"')
    assert set(load_hooks(written(tmp_path, SHOP + elsewhere))) == {"shop", "second"}


@pytest.mark.parametrize("command", ["service", "worker"])
def test_a_service_with_a_file_that_cannot_work_does_not_start(tmp_path: Path, command: str) -> None:
    path = written(tmp_path, changed('"watermarked/"', '"incoming/"'))
    ended = subprocess.run(
        [sys.executable, "-m", command],
        env={"MESHMARK_HOOKS_FILE": str(path), "MESHMARK_DATA_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert ended.returncode == 2
    assert ended.stderr.startswith("MESHMARK_HOOKS_FILE: ")
    assert ended.stderr.count("\n") == 1
    assert TOKEN not in ended.stderr
