"""The answers of a study, and their table beside the paper's."""

import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.markdown import NOTHING, table
from core.validation import describe

QUESTIONS = {  # of the paper's supplement, section "User Study", in its own order
    "visibility": "Are the watermarks visible from different views?",
    "placement": "Are the watermarks' placement and orientation good?",
    "readability": "Are the watermark texts readable?",
    "geometry": "Is the asset's geometry/shape preserved?",
    "semantics": "Is the asset's semantics preserved?",
    "saliency": "Are the asset's salient areas protected?",
}
# Share of "yes" in the paper's table of the study: of untextured and of textured assets.
PAPER = {
    ("untextured", "Li et al. (paper)"): (0.387, 0.066, 0.208, 0.660, 1.0, 0.566),
    ("untextured", "the paper's (paper)"): (0.959, 0.793, 0.963, 1.0, 1.0, 0.793),
    ("textured", "Li et al. (paper)"): (0.462, 0.076, 0.295, 0.591, 0.984, 0.515),
    ("textured", "the paper's (paper)"): (0.818, 0.709, 0.822, 0.984, 1.0, 0.814),
}
SAMPLE = "**Sample answers: made up to show this table. Nobody was asked.**"
LARGEST = 2**24  # bytes of a file

Id = Annotated[str, Field(pattern="^[0-9a-f]{12}$")]
File = TypeVar("File", bound=BaseModel)


class KeyTrial(BaseModel):
    """One trial: its asset, and the methods of its two sides."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    asset: str
    textured: bool
    delivered: bool
    first: str
    second: str


class Key(BaseModel):
    """The key of a study: which method is which. It is kept from those who answer."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_: Annotated[Literal["meshmark.study-key/1"], Field(alias="schema")]
    study: Id
    count: int
    trials: dict[Id, KeyTrial]


class Answer(BaseModel):
    """One answer to one question."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    trial: Id
    side: Literal["first", "second"]
    question: Literal["visibility", "placement", "readability", "geometry", "semantics", "saliency"]
    yes: bool


class Answers(BaseModel):
    """Everything that one person answered."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_: Annotated[Literal["meshmark.study-answers/1"], Field(alias="schema")]
    study: Id
    participant: Id
    sample: bool = False
    answers: Annotated[list[Answer], Field(max_length=100_000)]


def read_key(path: Path) -> Key:
    """The key of a study.

    Raises:
        MeshmarkError: ``missing_file``, ``malformed_file``.
    """
    return _read(path, Key, "key of a study", "Give the file that `meshmark study --out` wrote beside its page.")


def read_answers(path: Path, key: Key) -> Answers:
    """The answers of one person.

    Raises:
        MeshmarkError: ``missing_file``, ``malformed_file``; ``invalid_parameters`` for those to another study.
    """
    found = _read(path, Answers, "file of answers", "Give the files that the page of the study saved.")
    if found.study != key.study or not {answer.trial for answer in found.answers} <= key.trials.keys():
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"{path} has answers to another study ({found.study}; the key is of {key.study}).",
            "Give answers and key of the same page.",
        )
    return found


def _read(path: Path, model: type[File], name: str, remedy: str) -> File:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise MeshmarkError(ErrorCode.MISSING_FILE, f"{path} cannot be read: {error.strerror}.", remedy) from None
    problem = "it is too large"
    if len(data) <= LARGEST:
        try:
            return model.model_validate_json(data)
        except ValidationError as error:
            problem = describe(error.errors(), "file")
    raise MeshmarkError(ErrorCode.MALFORMED_FILE, f"{path} is no {name}: {problem}.", remedy)


def tally(key: Key, people: Sequence[Answers]) -> str:
    """Markdown table of the share of "yes", by kind of asset, method and question, with the paper's rows."""
    said: dict[tuple[str, str], dict[str, list[bool]]] = defaultdict(lambda: defaultdict(list))
    latest = {  # who answered twice counts as he answered last
        (person.participant, answer.trial, answer.side, answer.question): answer.yes
        for person in people
        for answer in person.answers
    }
    for (_, trial, side, question), yes in latest.items():
        shown = key.trials[trial]
        kind = "textured" if shown.textured else "untextured"
        said[kind, shown.first if side == "first" else shown.second][question].append(yes)
    body = []
    for kind in ("untextured", "textured"):
        ours = sorted(method for each, method in said if each == kind)
        for method in ours:
            means = [said[kind, method][question] for question in QUESTIONS]
            body.append([kind, f"`{method}`", *(_share(yes) for yes in means), str(max(map(len, means)))])
        if ours:
            body += [[kind, name, *(f"{value:.3f}" for value in values), NOTHING]
                     for (each, name), values in PAPER.items() if each == kind]  # fmt: skip
    head = ["assets", "method", *(name.capitalize() for name in QUESTIONS), "Answers"]
    clay = sum(not trial.delivered for trial in key.trials.values())
    people_there = len({person.participant for person in people})
    about = (
        f"{people_there} people, {len(key.trials)} assets, {key.count} marks asked for; {clay} of the assets shown as "
        'grey clay. Share of "yes".'
    )
    lines = [about, "", table(head, body)]
    return "\n".join([SAMPLE, "", *lines] if any(person.sample for person in people) else lines) + "\n"


def _share(answers: Sequence[bool]) -> str:
    return f"{sum(answers) / len(answers):.3f}" if answers else NOTHING


def key_json(study: str, count: int, shown: dict[str, dict[str, Any]]) -> str:
    """A key as JSON."""
    return json.dumps({"schema": "meshmark.study-key/1", "study": study, "count": count, "trials": shown}, indent=1)
