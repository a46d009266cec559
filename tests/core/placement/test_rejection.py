from core.placement.rejection import REASONS, Stage


def test_every_stage_that_drops_boxes_says_why_and_what_helps() -> None:
    assert [*REASONS] == [stage for stage in Stage if stage not in (Stage.CANDIDATES, Stage.DISTINCT)]
    assert all(reason and remedy for reason, remedy in REASONS.values())
