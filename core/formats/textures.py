"""Images beside a model: those that can be carried, and their size."""

from collections.abc import Iterable

from core.budgets import Budgets, within
from core.formats.assembly import dropped
from core.formats.polygons import Material
from core.gltf.images import image_size, mime_type
from core.notices import Notice

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".webp")


def usable_image(path: str, image: bytes | None, warnings: list[Notice]) -> bytes | None:
    """An encoded image if a glTF can hold it; otherwise a warning and ``None``."""
    if image is None:
        warnings.append(
            dropped(f"The texture {path[:60]!r} is not in the upload.", "Send it in one ZIP archive with the model.")
        )
    elif mime_type(image) is None:
        warnings.append(
            dropped(
                f"The texture {path[:60]!r} is dropped: it is not a PNG, JPEG or WebP image, which a GLB can hold.",
                "Save it as PNG or JPEG, and change its name in the material file.",
            )
        )
        return None
    return image


def check_pixels(materials: Iterable[Material], budgets: Budgets) -> None:
    """Refuse textures that are too large to be drawn.

    Raises:
        MeshmarkError: ``budget_exceeded``.
    """
    images = {image for material in materials for image in (material.texture, material.normal_map) if image}
    sizes = [image_size(memoryview(image)) or (0, 0) for image in images]
    within(sum(width * height for width, height in sizes), budgets.image_pixels, "texture pixels")
