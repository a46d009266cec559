"""Orders of the client name what the service takes, and the client is light."""

import subprocess
import sys
from enum import EnumType
from types import NoneType
from typing import Literal, get_args, get_origin, get_type_hints

from core import parameters
from core.labels.profiles import Label
from service.client.jobs import ENDED
from service.client.orders import FORM_FIELDS, OF_WATERMARKS, BatchItem, Marking, Order, Parameters, watermark_form
from service.jobs import events
from service.routes import batch
from service.routes.schemas import PriorityName


def test_a_client_takes_every_parameter_and_no_other() -> None:
    assert {*get_type_hints(Marking), "text"} == set(parameters.Parameters.model_fields)
    assert set(get_type_hints(Parameters)) == set(parameters.Parameters.model_fields)
    assert set(get_type_hints(BatchItem)) == set(batch.BatchItem.model_fields)


def test_choices_are_those_of_the_service() -> None:
    hints = get_type_hints(Order)
    for name, field in parameters.Parameters.model_fields.items():
        [kind, *_] = [each for each in get_args(field.annotation) or [field.annotation] if each is not NoneType]
        if isinstance(kind, EnumType):
            assert get_origin(hints[name]) is Literal, name
            assert [*get_args(hints[name])] == [*kind.__members__.values()], name
    assert get_args(hints["label"]) == (*Label,)
    assert get_args(hints["priority"]) == get_args(PriorityName)
    assert set(ENDED) == set(events.ENDED)


def test_what_is_no_parameter_goes_beside_them() -> None:
    order = Order(size=3.0, seed=7, metadata={"order": "4711"}, priority="low", logo=b"<svg/>", cache=False)
    form = watermark_form("folder/spot.glb", "HI", None, order)
    assert form.params == {"text": "HI", "size": 3.0, "seed": 7}
    assert form.files == {"file": ("spot.glb", "folder/spot.glb"), "logo": ("logo", b"<svg/>")}
    assert form.data() == {
        "params": '{"text": "HI", "size": 3.0, "seed": 7}',
        "metadata": '{"order": "4711"}',
        "priority": "low",
    }
    assert form.query == {"cache": "false"}
    assert set(FORM_FIELDS) < set(OF_WATERMARKS)
    assert set(get_type_hints(Order)) - set(get_type_hints(Marking)) == set(OF_WATERMARKS)


def test_the_client_loads_nothing_heavy() -> None:
    script = "import sys, service.client\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert {"service.client", "httpx2"} <= set(loaded)
    assert {"torch", "numpy", "fastapi", "pydantic", "sqlalchemy", "core"}.isdisjoint(loaded)
