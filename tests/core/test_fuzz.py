from tests.fuzz import mutate, run, seeds


def test_no_mutated_file_ends_in_anything_but_a_watermark_or_an_error_of_ours() -> None:
    results = run(range(240), processes=1)
    assert {number: ending for number, ending in results.items() if ending.startswith("FOUND")} == {}
    endings = list(results.values())
    assert endings.count("marked") > 20  # the mutations are not all fatal
    assert endings.count("marked, unjudged") < 10


def test_a_case_is_the_same_every_time() -> None:
    assert mutate(7) == mutate(7)
    assert mutate(7) != mutate(7 + len(seeds()))
