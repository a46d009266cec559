"""Copies by both clients."""

from typing import Any

import pytest

from service.client import MeshmarkProblem
from tests.service.client.conftest import MODEL, Either, Hand
from tests.worker.engines import asset


def test_copies_are_sent_with_an_asset_asked_for_later_and_listed(either: Either, hand: Hand) -> None:
    texts = [{"text": "ORDER-1", "metadata": {"customer": "17"}}, {"text": "ORDER-2"}]
    with hand.working():
        job: Any = either(either.client.watermark(asset(), "HI", copies=texts))
        more = either(either.client.copy(job.id, [{"text": "ORDER-3"}]))
        assert [each.facts["text"] for each in more] == ["ORDER-3"]
        copies = either.all(either.client.copies(job.id))
        assert [(each.facts["text"], each.metadata) for each in copies] == [
            ("ORDER-1", {"customer": "17"}),
            ("ORDER-2", {}),
            ("ORDER-3", {}),
        ]
        ended = either(either(copies[2].result()).refresh())
    assert either(ended.content()) == MODEL
    assert ended.facts["copy_of"] == job.id
    with pytest.raises(MeshmarkProblem) as caught:
        either(either.client.copy(ended.id, texts))
    assert caught.value.code == "not_found"
