"""Regions of an asset as a request names them: by node, by material, or by a box."""

from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from core.validation import StrictModel

MAX_NAME_LENGTH = 256

Name = Annotated[str, Field(min_length=1, max_length=MAX_NAME_LENGTH)]
Point = tuple[float, float, float]


class NodeRegion(StrictModel):
    """All nodes of a name, and everything below them. What a bone moves counts as below the bone."""

    model_config = ConfigDict(frozen=True, json_schema_extra={"examples": [{"node": "Head"}]})

    node: Annotated[Name, Field(description="Name of a node; of a node without one, the name of its mesh.")]


class MaterialRegion(StrictModel):
    """Everything of one material."""

    model_config = ConfigDict(frozen=True, json_schema_extra={"examples": [{"material": "Glass"}]})

    material: Annotated[Name, Field(description="Name of a material.")]


class Box(StrictModel):
    """An upright box in the asset's own world coordinates, not in the size-30 frame.

    These are the coordinates of the GLB that comes out: glTF's default scene, metres, Y up. A GLB or glTF keeps its
    own; a 3MF or DAE is converted to them.
    """

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    min: Annotated[Point, Field(description="The corner with the smallest x, y and z.")]
    max: Annotated[Point, Field(description="The corner with the largest x, y and z.")]

    @model_validator(mode="after")
    def _has_extent(self) -> Self:
        if not all(low < high for low, high in zip(self.min, self.max, strict=True)):
            raise PydanticCustomError("box", "Each of x, y and z should be smaller in min than in max")
        return self


class BoxRegion(StrictModel):
    """Everything inside a box."""

    model_config = ConfigDict(
        frozen=True,
        json_schema_extra={"examples": [{"box": {"min": [-0.3, 1.4, -0.3], "max": [0.3, 1.9, 0.3]}}]},
    )

    box: Box


def _kind_of_region(value: Any) -> str | None:
    """The one of the three keys that a region has, from a mapping or a model."""
    keys = value if isinstance(value, dict) else type(value).model_fields if isinstance(value, BaseModel) else ()
    kinds = [kind for kind in ("node", "material", "box") if kind in keys]
    return kinds[0] if len(kinds) == 1 else None


Region = Annotated[
    Annotated[NodeRegion, Tag("node")] | Annotated[MaterialRegion, Tag("material")] | Annotated[BoxRegion, Tag("box")],
    Discriminator(
        _kind_of_region,
        custom_error_type="region",
        custom_error_message="Input should be an object with exactly one of the keys node, material and box",
    ),
]
