"""Answers of people become the paper's table of its user study."""

import json
from pathlib import Path
from typing import Any

import pytest

from core.errors import ErrorCode, MeshmarkError
from core.lab.study.answers import QUESTIONS, Key, read_answers, read_key, tally

STUDY, COW, BOX = "0" * 12, "a" * 12, "b" * 12

ANSWER = {"trial": COW, "side": "first", "question": "geometry", "yes": True}


@pytest.fixture
def key(tmp_path: Path) -> Key:
    shown = {
        COW: {"asset": "cow.glb", "textured": True, "delivered": False, "first": "li", "second": "meshmark"},
        BOX: {"asset": "box.obj", "textured": False, "delivered": False, "first": "meshmark", "second": "li"},
    }
    path = tmp_path / "study.key.json"
    path.write_text(json.dumps({"schema": "meshmark.study-key/1", "study": STUDY, "count": 16, "trials": shown}))
    return read_key(path)


def answered(folder: Path, person: str, *said: tuple[str, str, str, bool], **changes: Any) -> Path:
    answers = [dict(zip(("trial", "side", "question", "yes"), one, strict=True)) for one in said]
    whole = {"schema": "meshmark.study-answers/1", "study": STUDY, "participant": person * 12, "answers": answers}
    path = folder / f"{person}.json"
    path.write_text(json.dumps(whole | changes))
    return path


def cells(table: str, kind: str, method: str) -> list[str]:
    [row] = [line for line in table.splitlines() if line.startswith(f"| {kind} | {method} |")]
    return [cell.strip() for cell in row.split("|")[3:-1]]


def test_yes_is_counted_by_method_question_and_kind_of_asset_beside_the_papers_shares(key: Key, tmp_path: Path) -> None:
    said = (COW, "second", "visibility", True), (COW, "first", "visibility", False), (BOX, "first", "placement", True)
    one = answered(tmp_path, "1", *said)
    two = answered(tmp_path, "2", (COW, "second", "visibility", False), (COW, "second", "readability", True))
    table = tally(key, [read_answers(path, key) for path in (one, two)])
    assert cells(table, "textured", "`meshmark`") == ["0.500", "-", "1.000", "-", "-", "-", "2"]
    assert cells(table, "textured", "`li`")[0] == "0.000"
    assert cells(table, "untextured", "`meshmark`")[1] == "1.000"
    assert cells(table, "textured", "the paper's (paper)")[0] == "0.818"
    assert "2 people, 2 assets, 16 marks asked for; 2 of the assets shown as grey clay" in table
    assert [name.lower() for name in table.splitlines()[2].replace(" ", "").split("|")[3:9]] == list(QUESTIONS)
    assert "made up" not in table


def test_who_answers_a_question_again_counts_as_he_answered_last(key: Key, tmp_path: Path) -> None:
    first = answered(tmp_path, "1", (COW, "second", "visibility", True))
    people = [read_answers(first, key)]
    people.append(read_answers(answered(tmp_path, "1", (COW, "second", "visibility", False)), key))
    assert cells(tally(key, people), "textured", "`meshmark`")[0] == "0.000"


def test_a_table_of_sample_answers_says_that_nobody_was_asked(key: Key, tmp_path: Path) -> None:
    sample = answered(tmp_path, "1", (COW, "second", "visibility", True), sample=True)
    assert tally(key, [read_answers(sample, key)]).startswith("**Sample answers: made up")


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"study": "f" * 12}, ErrorCode.INVALID_PARAMETERS),
        ({"answers": [ANSWER | {"trial": "c" * 12}]}, ErrorCode.INVALID_PARAMETERS),
        ({"answers": [ANSWER | {"side": "third"}]}, ErrorCode.MALFORMED_FILE),
        ({"schema": "meshmark.report/1"}, ErrorCode.MALFORMED_FILE),
    ],
)
def test_answers_to_something_else_are_refused(
    key: Key, tmp_path: Path, changes: dict[str, Any], code: ErrorCode
) -> None:
    with pytest.raises(MeshmarkError) as error:
        read_answers(answered(tmp_path, "1", **changes), key)
    assert error.value.code is code


def test_a_file_that_is_no_key_or_not_there_is_told(tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_bytes(b"\x00")
    for name, code in (("bad.json", ErrorCode.MALFORMED_FILE), ("none.json", ErrorCode.MISSING_FILE)):
        with pytest.raises(MeshmarkError) as error:
            read_key(tmp_path / name)
        assert error.value.code is code
