import argparse
import json
from pathlib import Path

import pytest

from core.cli_text import add_label_options, add_text_options
from core.parameters import Parameters


def given(*options: str) -> Parameters:
    command = argparse.ArgumentParser(exit_on_error=False)
    add_text_options(command)
    add_label_options(command)
    values = vars(command.parse_args(options))
    assert values.pop("logo") is None
    return Parameters(**values)


def test_the_setting_of_the_text_is_that_of_the_parameters() -> None:
    options = "--text a\\nb --align left --line-spacing 1.5 --letter-spacing 0.1 --direction vertical --language ja"
    assert given(*options.split()) == Parameters.model_validate(
        {
            "text": "a\nb",
            "align": "left",
            "line_spacing": 1.5,
            "letter_spacing": 0.1,
            "direction": "vertical",
            "language": "ja",
        }
    )


def test_without_options_the_defaults_are_those_of_the_parameters() -> None:
    assert given("--text", "a") == Parameters(text="a")


def test_a_direction_that_is_none_is_refused() -> None:
    with pytest.raises(argparse.ArgumentError):
        given("--text", "a", "--direction", "up")


def test_a_label_is_asked_for_with_a_file_of_statements(tmp_path: Path) -> None:
    (tmp_path / "d.json").write_text(json.dumps({"creator": "me"}))
    asked = given("--label", "cn", "--declaration", str(tmp_path / "d.json"), "--metadata-only")
    assert asked == Parameters.model_validate({"label": "cn", "declaration": {"creator": "me"}, "metadata_only": True})


@pytest.mark.parametrize("content", [None, "{"])
def test_statements_that_cannot_be_read_are_refused(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "d.json").write_text(content)
    with pytest.raises(argparse.ArgumentError, match="cannot be read"):
        given("--label", "cn", "--declaration", str(tmp_path / "d.json"))
