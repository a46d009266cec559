"""The surface that carries the watermarks, and the facts about it that placement weighs."""

from dataclasses import dataclass

from core.analysis.features import FeatureRegions
from core.analysis.opacity import Opacity
from core.analysis.regions import Regions
from core.analysis.saliency import Saliency
from core.analysis.skinning import SkinDeformation
from core.analysis.texture import TextureSaliency
from core.arrays import Bool, Int
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface


@dataclass(frozen=True, eq=False)
class Carrier:
    """A surface and its faces that may support boxes.

    Attributes:
        surface: the asset.
        index: over ``surface``.
        cuttable: (F,) the faces that may support boxes. The others still occlude and obstruct.
        component: (F,) number of each face's component, -1 for none; a text lies on a single one.
        opacity: tests points of the cuttable faces for opacity; None where these are opaque everywhere.
    """

    surface: Surface
    index: SpatialIndex
    cuttable: Bool
    component: Int
    opacity: Opacity | None = None


@dataclass(frozen=True, eq=False)
class SurfaceFacts:
    """Facts about a surface.

    Attributes:
        saliency: of its shape.
        texture: of its texture; None where it has one colour.
        skin: the joints it follows; None where it has no skin.
        regions: that the request keeps out of or prefers; None where it names none.
        features: of its shape, texture and skin that no mark should touch; None where it was not searched for any.
    """

    saliency: Saliency
    texture: TextureSaliency | None = None
    skin: SkinDeformation | None = None
    regions: Regions | None = None
    features: FeatureRegions | None = None
