"""The wish for a second, light model for public display."""

from typing import Annotated

from pydantic import ConfigDict, Field

from core.validation import StrictModel


class PreviewModel(StrictModel):
    """Limits of a preview model. Part of :class:`core.parameters.Parameters`."""

    model_config = ConfigDict(frozen=True)

    triangles: Annotated[
        int,
        Field(
            ge=500,
            le=2_000_000,
            description="The most triangles that the asset keeps, counted as they are drawn; letters come on top.",
        ),
    ] = 20_000
    texture: Annotated[
        int, Field(ge=16, le=4096, description="The most pixels that the longer side of each of its images keeps.")
    ] = 512
    alone: Annotated[
        bool, Field(description="It takes the place of the model: nothing else of the asset is delivered.")
    ] = False
