import json
from typing import Any

import pytest

from core.choices import Mode, Preset, Profile, Solver, Strength
from core.errors import ErrorCode, MeshmarkError
from core.parameters import AUTO_COLORS, Parameters, parse_parameters


def test_a_text_is_all_one_needs() -> None:
    asked = parse_parameters({"text": "watermark"}).resolved()
    assert (asked.count, asked.size, asked.relief, asked.solver) == (16, None, None, Solver.LEVENBERG_MARQUARDT)


def test_json_and_mappings_mean_the_same() -> None:
    data = {"text": "ab", "preset": "paper", "mode": "deboss", "color": "#AABBCC", "seed": 7}
    assert parse_parameters(json.dumps(data)) == parse_parameters(data)
    assert parse_parameters(data).color == "#aabbcc"


def test_letters_may_have_one_colour_one_of_a_list_or_one_of_the_built_in_ones() -> None:
    assert Parameters.model_validate({"text": "a", "color": "none"}).resolved().palette == ()
    assert Parameters(text="a", color="#AABBCC").palette == ("#aabbcc",)
    assert parse_parameters('{"text": "a", "color": ["#AABBCC", "#000000"]}').palette == ("#aabbcc", "#000000")
    assert Parameters(text="a", color="auto").palette == AUTO_COLORS


@pytest.mark.parametrize(
    ("preset", "palette"), [("merchandise", AUTO_COLORS), ("provenance", AUTO_COLORS), ("paper", ())]
)
def test_without_a_colour_the_preset_says_which(preset: str, palette: tuple[str, ...]) -> None:
    asked = {"text": "a", "preset": preset}
    assert parse_parameters(asked | {"color": None}).resolved() == parse_parameters(asked).resolved()
    assert parse_parameters(asked).resolved().palette == palette


def test_letters_have_the_profile_that_is_asked_for_and_codes_are_flat() -> None:
    presets = {preset: Parameters(text="a", preset=preset).resolved().profile for preset in Preset}
    assert presets == {
        Preset.MERCHANDISE: Profile.SOFT,
        Preset.PROVENANCE: Profile.SOFT,
        Preset.PAPER: Profile.FLAT,
    }
    assert Parameters(text="a", profile=Profile.FLAT).resolved().profile is Profile.FLAT
    code = Parameters(text="a", qr="https://example.com")
    assert code.resolved().profile is Profile.FLAT
    code.require_content(logo=False)
    with pytest.raises(MeshmarkError, match="profile") as caught:
        code.model_copy(update={"profile": Profile.SOFT}).require_content(logo=False)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_what_is_given_wins_over_the_preset() -> None:
    asked = Parameters(text="a", preset=Preset.PAPER, relief=0.3).resolved()
    assert (asked.relief, asked.size, asked.count, asked.solver) == (0.3, 5.5, 10, Solver.ADAM)


@pytest.mark.parametrize(("strength", "count"), [("discreet", 6), ("standard", 16), ("strong", 24)])
def test_a_strength_says_how_many_marks_there_are_unless_that_is_given(strength: str, count: int) -> None:
    asked = parse_parameters({"text": "a", "strength": strength})
    assert asked.resolved().count == count
    assert parse_parameters({"text": "a", "strength": strength, "count": 3, "size": 2.5}).resolved().count == 3


def test_a_strength_takes_the_place_of_a_presets_width_and_the_papers_has_none_but_its_own() -> None:
    widths = [Parameters(text="a", preset=Preset.PROVENANCE, strength=one).resolved().size for one in Strength]
    assert widths == [None, 3.0, None]
    assert Parameters(text="a", size=4.0, strength=Strength.STRONG).resolved().size == 4.0
    with pytest.raises(MeshmarkError, match="strength") as caught:
        Parameters(text="a", preset=Preset.PAPER, strength=Strength.STRONG).require_content(logo=False)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_a_size_is_the_widest_but_the_papers_the_only_one_and_an_exact_one_must_be_given() -> None:
    exact = {preset: Parameters(text="a", preset=preset).resolved().size_exact for preset in Preset}
    assert exact == {Preset.MERCHANDISE: False, Preset.PROVENANCE: False, Preset.PAPER: True}
    assert Parameters(text="a", preset=Preset.PAPER, size=4.0).resolved().size_exact
    assert not Parameters(text="a", preset=Preset.PAPER, size_exact=False).resolved().size_exact
    Parameters(text="a", size=4.0, size_exact=True).require_content(logo=False)
    Parameters(text="a", preset=Preset.PROVENANCE, size_exact=True).require_content(logo=False)
    with pytest.raises(MeshmarkError, match="size_exact") as caught:
        Parameters(text="a", size_exact=True).require_content(logo=False)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_relief_grows_with_the_text_unless_it_is_given_and_is_negative_when_sunken() -> None:
    assert Parameters(text="a").relief_at(0.7) == pytest.approx(0.158 * 0.7)
    assert Parameters(text="a", mode=Mode.DEBOSS).relief_at(0.25) == pytest.approx(-0.158 * 0.25)
    assert Parameters(text="a", relief=0.1).relief_at(0.7) == 0.1


@pytest.mark.parametrize("text", ["", " ", "\t \n", "\u3000"])
def test_a_text_without_letters_has_its_own_code(text: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_parameters({"text": text}).require_content(logo=False)
    assert caught.value.code is ErrorCode.EMPTY_TEXT


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"size": -1}, "size"),
        ({"size": 31}, "size"),
        ({"size": float("nan")}, "size"),
        ({"relief": 0}, "relief"),
        ({"relief": float("inf")}, "relief"),
        ({"count": 0}, "count"),
        ({"count": 2.5}, "count"),
        ({"seed": -1}, "seed"),
        ({"color": "red"}, "color"),
        ({"color": "#12345"}, "color"),
        ({"color": []}, "color"),
        ({"color": ["#102030", "red"]}, "color"),
        ({"color": ["#102030"] * 100}, "color"),
        ({"color": 7}, "color"),
        ({"mode": "engrave"}, "mode"),
        ({"preset": ""}, "preset"),
        ({"text": "x" * 201}, "text"),
        ({"text": "a\n" * 6 + "b"}, "text"),
        ({"language": "klingon"}, "language"),
        ({"language": "qq"}, "language"),
        ({"language": "zh-Hans-"}, "language"),
        ({"letter_spacing": -0.1}, "letter_spacing"),
        ({"direction": "up"}, "direction"),
        ({"text": 5}, "text"),
        ({"colour": "#000000"}, "colour"),
        ({"keep_out": {"node": "Head"}}, "keep_out: Input should be a valid list"),
        ({"keep_out": ["Head"]}, "keep_out.0: Input should be an object with exactly one of the keys node, material"),
        ({"keep_out": [{}]}, "keep_out.0: Input should be an object with exactly one"),
        (
            {"prefer": [{"node": "a"}, {"node": "a", "material": "b"}]},
            "prefer.1: Input should be an object with exactly",
        ),
        ({"prefer": [{"nodes": "a"}]}, "prefer.0: Input should be an object with exactly one"),
        ({"keep_out": [{"node": "a", "depth": 1}]}, "keep_out.0.node.depth: Extra inputs are not permitted"),
        ({"keep_out": [{"node": ""}]}, "keep_out.0.node: String should have at least 1"),
        ({"keep_out": [{"material": "x" * 257}]}, "keep_out.0.material: String should have at most 256"),
        ({"keep_out": [{"material": None}]}, "keep_out.0.material: Input should be a valid string"),
        ({"keep_out": [{"node": "a"}] * 33}, "keep_out: List should have at most 32 items"),
        ({"keep_out": [{"box": {"min": [0, 0, 0]}}]}, "keep_out.0.box.max: Field required"),
        ({"keep_out": [{"box": {"min": [0, 0], "max": [1, 1, 1]}}]}, "keep_out.0.box.min.2: Field required"),
        ({"keep_out": [{"box": {"min": [0, 0, 0], "max": [1, 1, 1, 1]}}]}, "keep_out.0.box.max: Tuple should have"),
        ({"keep_out": [{"box": {"min": [0, 0, 0], "max": [1, 0, 1]}}]}, "keep_out.0.box: Each of x, y and z should be"),
        (
            {"prefer": [{"box": {"min": [0, 0, 0], "max": [1, 1, float("nan")]}}]},
            "prefer.0.box.max.2: Input should be a",
        ),
        ({"prefer": [{"box": {"min": [-1e999, 0, 0], "max": [1, 1, 1]}}]}, "prefer.0.box.min.0: Input should be a"),
        ({"prefer": [{"box": {"min": [0, 0, 0], "max": [1, 1, 1], "unit": "m"}}]}, "prefer.0.box.unit: Extra inputs"),
    ],
)
def test_each_wrong_value_is_named(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_parameters({"text": "a"} | wrong)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS
    assert named in caught.value.message


def test_regions_come_back_as_they_were_sent() -> None:
    regions = [
        {"node": "Head"},
        {"material": "Glass"},
        {"box": {"min": [-1.0, 0.0, 2.5], "max": [1.0, 0.5, 3.0]}},
    ]
    asked = parse_parameters({"text": "a", "keep_out": regions, "prefer": regions[:1]})
    dumped = asked.resolved().model_dump(mode="json")
    assert (dumped["keep_out"], dumped["prefer"]) == (regions, regions[:1])
    assert parse_parameters(json.dumps(dumped)) == asked.resolved()


@pytest.mark.parametrize("broken", ["", "{", "[]", "null", '"text"', b"\xff", '{"text": NaN}'])
def test_broken_json_is_an_error_of_its_own_kind(broken: str | bytes) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_parameters(broken)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_a_request_needs_a_text_or_a_logo_or_a_qr_code_and_not_both_of_these() -> None:
    parse_parameters({}).require_content(logo=True)
    parse_parameters({"qr": "https://a.example"}).require_content(logo=False)
    with pytest.raises(MeshmarkError, match="both a logo and `qr`") as caught:
        parse_parameters({"qr": "https://a.example"}).require_content(logo=True)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_the_place_of_a_logo_that_is_not_there_is_refused_unless_it_is_the_usual_one() -> None:
    above = parse_parameters({"text": "HI", "logo_position": "above"})
    above.require_content(logo=True)
    parse_parameters({"text": "HI", "qr": "https://a.example", "logo_position": "above"}).require_content(logo=False)
    parse_parameters({"text": "HI", "logo_position": "left"}).require_content(logo=False)
    with pytest.raises(MeshmarkError, match="`logo_position`") as caught:
        above.require_content(logo=False)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_a_logo_among_the_parameters_is_told_to_be_a_file() -> None:
    with pytest.raises(MeshmarkError, match="logo") as caught:
        parse_parameters({"text": "HI", "logo": "logo.svg"})
    assert caught.value.remedy.startswith("Send the logo as a file")


def test_a_label_brings_its_words_and_marks_as_large_as_its_rule_asks_for() -> None:
    asked = parse_parameters({"label": "cn", "preset": "provenance"})
    asked.require_content(logo=False)
    assert (asked.resolved().text, asked.resolved().size, asked.resolved().count) == ("AI生成", None, 24)
    assert asked.resolved().resolved() == asked.resolved()
    given = parse_parameters({"label": "cn", "preset": "provenance", "text": "由AI合成", "size": 2.0, "count": 1})
    given.require_content(logo=False)
    assert (given.resolved().text, given.resolved().size, given.resolved().count) == ("由AI合成", 2.0, 1)
    assert parse_parameters({"text": "a"}).resolved().label is None


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ({"label": "cn", "text": "AI"}, ErrorCode.INVALID_PARAMETERS),
        ({"metadata_only": True}, ErrorCode.INVALID_PARAMETERS),
        ({"metadata_only": True, "label": "eu", "explain": True}, ErrorCode.INVALID_PARAMETERS),
        ({"metadata_only": True, "text": "a"}, ErrorCode.INVALID_PARAMETERS),
        ({"label": "custom"}, ErrorCode.EMPTY_TEXT),
        ({"declaration": {"creator": "me"}}, ErrorCode.EMPTY_TEXT),
    ],
)
def test_a_label_that_says_nothing_or_something_else_is_refused(asked: dict[str, Any], code: ErrorCode) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_parameters(asked).require_content(logo=False)
    assert caught.value.code is code


@pytest.mark.parametrize(
    "asked",
    [
        {"text": "a", "preview_model": {"triangles": 499}},
        {"text": "a", "preview_model": {"texture": 4097}},
        {"text": "a", "preview_model": {"tris": 1000}},
        {"text": "a", "preview_model": {"alone": True}, "explain": True},
        {"text": "a", "preview_model": {"alone": True}, "format": "stl"},
        {"metadata_only": True, "label": "eu", "preview_model": {}},
    ],
)
def test_a_preview_model_out_of_range_or_against_the_rest_of_the_request_is_refused(asked: dict[str, Any]) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_parameters(asked).require_content(logo=False)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS
    assert "preview_model" in caught.value.message


def test_a_label_alone_needs_no_text_and_measures_nothing() -> None:
    asked = parse_parameters({"metadata_only": True, "declaration": {"creator": "me"}, "evaluate": "full"})
    asked.require_content(logo=False)
    assert asked.resolved().evaluate == "none"
