"""Shared fixtures of the tests of the worker."""

from collections.abc import Iterator

import pytest

from worker.template import Template


@pytest.fixture
def template() -> Iterator[Template]:
    template = Template("tests.worker.engines:directed", threads=1)
    yield template
    template.close()
