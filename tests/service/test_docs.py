"""README and manual say of the service and the engine what is so: each table is held to the code it speaks of."""

import argparse
import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from dataclasses import asdict
from enum import StrEnum
from types import ModuleType
from typing import get_args

from prometheus_client import REGISTRY
from pydantic import BaseModel

from core.budgets import DEFAULT_BUDGETS
from core.cli.app import COMMANDS, load_command
from core.cli.status import MEANINGS, STATUS_OF, Status
from core.credentials.facts import Credentials, CredentialState
from core.embossing.refusal import EXPLAINED
from core.errors import ErrorCode
from core.lab.attacks.attack import ATTACKS
from core.lab.benchmark.options import METHODS
from core.lab.benchmark.published import QUALITY
from core.labels.declaration import Aigc, Declaration, SourceType
from core.labels.profiles import PROFILES
from core.labels.write import AIGC_PROPERTY, PROPERTIES, SOURCE_TYPE
from core.metrics.measurement import HIGHER_IS_BETTER, UNITS
from core.notices import NoticeCode
from core.parameters import PRESETS, Parameters, parse_parameters
from core.pipeline import STAGES
from core.report import AssetFacts, CopyFacts, Embossing, Engine, Frame, LabelFacts, Report, Watermark
from core.verify.parameters import MOST_TEXTS, VerificationParameters, parse_verification
from core.verify.report import FileLabel, ReadMark, VerificationReport
from service.__main__ import parser as service_parser
from service.app import create_app
from service.config import Settings
from service.hooks.config import FILE
from service.jobs.ledger import SIGNING
from service.jobs.ledger_metrics import LedgerCollector
from service.jobs.models import JobState
from service.problems import STATUS
from service.routes import events, watermarks
from service.routes.webhook_schemas import Event
from service.show_settings import as_variable
from tests.manual import MANUAL, README, ROOT, command_lines, names, page, rows
from tests.service.conftest import Client

EVERYTHING = "\n".join(path.read_text() for path in (README, *sorted(MANUAL.glob("*.md"))))
METHODS_BESIDE = ("meshmark", "paper", "li")
SAID: dict[object, str] = {None: "null", True: "true", False: "false"}  # values that JSON writes in another way


def test_the_table_of_settings_is_that_of_the_service() -> None:
    expected = [
        [f"`MESHMARK_{name.upper()}`", f"`{default}`" if (default := as_variable(field.default)) else "empty", text]
        for name, field in Settings.model_fields.items()
        if (text := field.description)
    ]
    assert rows("configuration", "Settings") == expected


def test_the_table_of_parameters_names_each_with_its_default_its_bounds_and_its_values() -> None:
    table = rows("parameters", "Parameters")
    assert [name for name, _, _ in table] == [f"`{name}`" for name in Parameters.model_fields]
    for (name, default, meaning), field in zip(table, Parameters.model_fields.values(), strict=True):
        if field.is_required():
            assert default == "required"
        elif field.default is not None:
            said = json.dumps(field.default) if field.default in (True, False, "") else str(field.default)
            assert default.strip("`") == said
        else:
            assert default in ("preset", "`null`")
        if isinstance(field.default, StrEnum):
            assert all(f"`{value}`" in meaning for value in type(field.default)), name
        bounds = [getattr(rule, side, None) for rule in field.metadata for side in ("ge", "le", "max_length")]
        for bound in filter(None, bounds):
            assert ("2^63 - 1" if bound == 2**63 - 1 else f"{bound:g}") in meaning, (name, bound)


def test_the_table_of_presets_is_that_of_the_engine() -> None:
    keys = ("size", "size_exact", "relief", "count", "color", "profile", "solver")
    expected = [
        [preset.value, *(SAID.get(values.get(key), str(values.get(key))) for key in keys)]
        for preset, values in PRESETS.items()
    ]
    assert [[cell.strip("`") for cell in row] for row in rows("parameters", "Presets")] == expected


def test_the_tables_of_errors_have_every_code_with_its_status_once() -> None:
    headings = re.findall(r"^## (.+)$", page("errors"), re.MULTILINE)
    table = [row for heading in headings for row in rows("errors", heading)]
    assert [(code.strip("`"), int(status)) for code, status, _, _ in table] == [*STATUS.items()]
    assert all(meaning and remedy for _, _, meaning, remedy in table)


def test_the_table_of_metrics_has_each_with_its_direction_and_its_unit() -> None:
    known = {name: better for kind in HIGHER_IS_BETTER.values() for name, better in kind.items()}
    table = {row[0].strip("`"): row[1:] for row in rows("metrics", "Metrics")}
    assert {name: better == "high" for name, (better, _, _) in table.items()} == known
    assert {name: table[name][1] for name in UNITS} == UNITS


def test_the_table_of_labels_is_that_of_the_engine() -> None:
    expected = [
        [
            f"`{label}`",
            profile.words.replace("\n", " / ") or "-",
            f"{100 * profile.height:g} %" if profile.height else "-",
            f"`{profile.source_type}`" if profile.source_type else "-",
            ", ".join(f"`{field}`" for field in profile.fields) or "-",
            "yes" if profile.aigc else "no",
            profile.source,
        ]
        for label, profile in PROFILES.items()
    ]
    assert rows("labels", "Profiles") == expected


def test_the_table_of_statements_has_each_with_the_property_that_it_is_written_to() -> None:
    table = rows("labels", "Declaration")
    assert [name.strip("`") for name, _ in table] == [*Declaration.model_fields]
    written = PROPERTIES | {"source_type": (SOURCE_TYPE, ""), "aigc": (AIGC_PROPERTY, "")}
    assert all(where.startswith(f"`{written[name.strip('`')][0]}`") for name, where in table)
    assert set(Aigc.model_fields) <= set(re.findall(r"`(\w+)`", dict(table)["`aigc`"]))
    assert all(f"`{source}`" in dict(table)["`source_type`"] for source in SourceType)


def test_the_tables_of_attacks_and_methods_are_those_of_the_benchmark() -> None:
    expected = [
        [f"`{name}`", f"{attack.strength:g}", f"{attack.low:g} to {attack.high:g}", attack.help]
        for name, attack in ATTACKS.items()
    ]
    assert rows("benchmark", "Attacks") == expected
    assert names("benchmark", "Methods") == [*METHODS]


def test_the_papers_figures_are_those_that_the_benchmark_prints() -> None:
    expected = [
        [dataset, f"`{method}`", *(f"{value:g}" for value in values.values())]
        for dataset, methods in QUALITY.items()
        for method, values in methods.items()
    ]
    assert rows("paper", "Published figures") == expected


def test_what_is_said_to_be_measured_beside_the_paper_is_what_the_benchmark_measured() -> None:
    measured = {row[0]: row[1:] for row in reversed(rows("benchmark", "Results"))}  # of two tables the first
    columns = {"assets accepted, of 33": 0, "OCR ↑": 4, "Ray ↑": 2, "coverage ↑": 3, "SMSE ↓": 5, "IPE ↓": 6}
    for name, *said in rows("paper", "Measured here"):
        found = [measured[method][columns[name]].strip("*").removesuffix(" of 33") for method in METHODS_BESIDE]
        assert said == found, name


def test_the_table_of_refused_places_is_that_of_the_engine() -> None:
    assert rows("report", "Reasons for refused places") == [
        [f"`{reason}`", meaning] for reason, (meaning, _) in EXPLAINED.items()
    ]


def test_the_tables_of_the_report_have_the_fields_of_its_model() -> None:
    table = rows("report", "The report")
    contents = {name: content for cell, content in table for name in re.findall(r"\w+", cell)}
    assert [*contents] == [field.alias or name for name, field in Report.model_fields.items()]
    sections: dict[str, type[BaseModel]] = {
        "asset": AssetFacts,
        "engine": Engine,
        "units": Frame,
        "copies": CopyFacts,
        "embossing": Embossing,
        "label": LabelFacts,
    }
    for name, section in sections.items():
        assert set(section.model_fields) <= set(re.findall(r"`(\w+)`", contents[name])), name
    marks = [name for cell, _ in rows("report", "Marks") for name in re.findall(r"\w+", cell)]
    assert marks == [*Watermark.model_fields]


def test_the_table_of_a_verification_has_the_fields_of_its_model() -> None:
    table = rows("verification", "Visible marks")
    contents = {name: content for cell, content in table for name in re.findall(r"\w+", cell)}
    assert [*contents] == [field.alias or name for name, field in VerificationReport.model_fields.items()]
    assert set(ReadMark.model_fields) <= set(re.findall(r"`(\w+)`", contents["marks"]))
    assert set(Credentials.model_fields) <= set(re.findall(r"`(\w+)`", page("verification")))
    assert names("verification", "Content Credentials") == list(CredentialState)
    assert set(FileLabel.model_fields) <= set(re.findall(r"`(?:asset\.)?(\w+)`", page("verification")))


def test_the_table_of_what_a_verification_is_asked_names_each_parameter_with_its_default_and_its_bound() -> None:
    table = rows("verification", "Over HTTP")
    assert [(name.strip("`"), default) for name, default, _ in table] == [
        (name, SAID.get(field.default, str(field.default)).lower())
        for name, field in VerificationParameters.model_fields.items()
    ]
    assert f"up to {MOST_TEXTS} " in table[0][2]


def test_the_tables_of_warnings_have_every_code_that_a_report_may_warn_of() -> None:
    assert names("report", "Warnings") == [*NoticeCode]
    source = "".join(path.read_text() for path in (ROOT / "core").rglob("*.py"))
    failures = {ErrorCode[name] for name in re.findall(r"\bNotice\(\s*ErrorCode\.(\w+)", source)}
    assert failures
    assert {*names("report", "Warnings with the code of an error")} == failures | {ErrorCode.RENDERING_UNAVAILABLE}


def test_the_table_of_budgets_is_that_of_the_engine() -> None:
    table = {name.strip("`"): int(most.replace(",", "")) for name, most, _ in rows("limits", "Budgets of an asset")}
    assert table == asdict(DEFAULT_BUDGETS)


def test_the_table_of_metrics_for_prometheus_is_that_of_the_processes(client: Client) -> None:
    ledger = LedgerCollector(client.worker.ledger.sessions)
    families = [family for collector in (REGISTRY, ledger) for family in collector.collect()]
    ours = {
        family.name + {"counter": "_total", "info": "_info"}.get(family.type, "")
        for family in families
        if family.name.startswith("meshmark_")
    }
    assert set(names("observability", "Metrics")) == ours


def test_the_example_of_an_error_is_what_the_service_answers(client: Client) -> None:
    example = re.search(r"```json\n(.*?)```", page("errors"), re.DOTALL)
    assert example is not None
    files = {"file": ("asset.stl", bytes(80) + b"\xff" * 4)}
    answer = client.http.post("/v1/watermarks", files=files, data={"params": '{"text": "watermark"}'})
    assert answer.json() == json.loads(example[1])


def test_every_state_and_every_stage_of_a_job_is_named() -> None:
    states = re.search(r"\*\*Job states\*\*.*\n*.*", page("concepts"))
    assert states is not None
    assert set(re.findall(r"`(\w+)`", states[0].partition("\n")[0])) == set(JobState)
    assert names("concepts", "Job") == [*STAGES, SIGNING]


def test_every_event_that_an_endpoint_may_name_is_on_the_page_of_webhooks() -> None:
    assert set(re.findall(r"(?:watermark|verification)\.[a-z]+", page("webhooks"))) - {"verification.md"} == {
        *get_args(Event)
    }


def routes(*modules: ModuleType) -> set[str]:
    return {route.path for module in modules for route in module.router.routes}


def test_the_addresses_in_the_examples_exist_and_every_address_has_one() -> None:
    variables = {"$ID": "{job_id}", "$URL": ""}
    named = {
        re.sub(r"\$\w+", lambda found: variables[found[0]], path)
        for path in re.findall(r"127\.0\.0\.1:8080(/v1[\w/$-]*)", EVERYTHING)
    }
    assert named <= set(create_app(Settings()).openapi()["paths"])
    assert routes(watermarks, events) <= named


def test_every_address_of_the_api_is_in_the_manual() -> None:
    for path in create_app(Settings()).openapi()["paths"]:
        parts = [re.escape(part) if part[:1] != "{" else r"[^/\s`]+" for part in path.split("/")]
        assert re.search("/".join(parts), EVERYTHING), path


def test_the_parameters_in_the_examples_are_valid() -> None:
    examples = re.findall(r"params=(\{.*?\})'", command_lines(EVERYTHING))
    examples += re.findall(r"```json\n(.*?)```", page("parameters"), re.DOTALL)
    assert len(examples) >= 4
    for example in examples:
        parse = parse_verification if "texts" in example else parse_parameters
        parse(example)


def test_the_hook_in_the_readme_can_be_configured() -> None:
    example = re.search(r"```toml\n(.*?)```", README.read_text(), re.DOTALL)
    assert example is not None
    FILE.validate_python(tomllib.loads(example[1]))


def commands(parser: argparse.ArgumentParser, *above: str) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Every command below a parser that has none below itself, in words."""
    below = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not below:
        yield " ".join(above), parser
    for action in below:
        for name, command in action.choices.items():
            yield from commands(command, *above, name)


def test_every_command_of_meshmark_is_shown_with_every_option_and_no_other() -> None:
    assert re.findall(r"^## ([a-z]+)$", page("command-line"), re.MULTILINE) == [*COMMANDS]
    for name in COMMANDS:
        known = {option for each in load_command(name).params for option in each.opts if option.startswith("--")}
        section = page("command-line").split(f"\n## {name}\n")[1].split("\n## ")[0]
        usage = re.search(rf"^meshmark {name} .*?```", section, re.MULTILINE | re.DOTALL)
        assert usage is not None
        assert set(re.findall(r"--[a-z][a-z0-9-]*", usage[0])) == {
            option for option in known if option.startswith("--")
        }, name


def test_the_table_of_exit_statuses_is_that_of_the_command_line() -> None:
    expected = [[str(status.value), meaning] for status, meaning in MEANINGS.items()]
    assert [row[:2] for row in rows("command-line", "Exit statuses")] == expected
    assert [*MEANINGS] == [*Status]
    listed = {
        code: int(row[0]) for row in rows("command-line", "Exit statuses") for code in re.findall(r"`(\w+)`", row[2])
    }
    assert listed == {code.value: status.value for code, status in STATUS_OF.items()}
    assert {*STATUS_OF} == {*ErrorCode}


def test_every_command_of_the_service_is_named() -> None:
    table = " ".join(names("command-line", "The service's commands"))
    for name, _ in commands(service_parser()):
        assert all(re.search(rf"\b{word}\b", table) for word in name.split()), name


def test_every_command_line_in_the_manual_can_be_parsed() -> None:
    """Those without placeholders: names, files and numbers as somebody would write them."""
    lines = re.findall(r"^(meshmark|python -m service) (.*)$", command_lines(EVERYTHING), re.MULTILINE)
    parsed = 0
    for program, words in lines:
        if re.search(r"\[|\||\.\.\.", words):
            continue
        arguments = shlex.split(words, comments=True)
        if program == "meshmark":
            load_command(arguments[0]).make_context(arguments[0], arguments[1:])
        else:
            service_parser().parse_args(arguments)
        parsed += 1
    assert parsed > 10


def test_the_house_of_the_manual_is_that_of_the_repository() -> None:
    """The tree on the page for contributors has every folder with modules."""
    tree = re.search(r"```\n(core/.*?)```", page("contributing"), re.DOTALL)
    assert tree is not None
    shown, above = set(), [""] * 9
    for indent, name in re.findall(r"^( *)(\w+)/ ", tree[1], re.MULTILINE):
        depth = len(indent) // 2
        above[depth + 1] = f"{above[depth]}/{name}".lstrip("/")
        shown.add(above[depth + 1])
    there = {
        init.parent.relative_to(ROOT).as_posix()
        for package in ("core", "service", "worker")
        for init in (ROOT / package).glob("**/__init__.py")
    }
    deeper = {"service/jobs/migrations"}
    assert shown - {"service/docs", "docker", "tests"} == there - deeper
