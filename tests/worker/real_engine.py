"""The real engine, which says in its report what it still had to import."""

import dataclasses
import sys
from typing import Any

from core.pipeline import Result, watermark
from core.pipeline import preload as preload


def observed(*arguments: Any, **named: Any) -> Result:
    before = set(sys.modules)
    result = watermark(*arguments, **named)
    imported = sorted(set(sys.modules) - before)
    return dataclasses.replace(result, report=result.report | {"imported": imported})
