"""Files of the console: our modules and those of its libraries, under names that change with their content."""

import json
import re
import sys
from base64 import b64encode
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from urllib.parse import urlsplit

from service.config import Settings
from service.static_file import StaticFile, as_sent

FOLDER = Path(__file__).parent
STATIC = FOLDER / "static"
LIBRARIES = FOLDER / "node_modules"
PREFIX = "/console/"
ADDONS = "three/examples/jsm/"
# Modules of the libraries by the names that ours import them by.
NAMED = {
    "htm": "htm/dist/htm.mjs",
    "preact": "preact/dist/preact.mjs",
    "preact/hooks": "preact/hooks/dist/hooks.mjs",
    "three": "three/build/three.module.js",
    "three/addons/controls/OrbitControls.js": f"{ADDONS}controls/OrbitControls.js",
    "three/addons/environments/RoomEnvironment.js": f"{ADDONS}environments/RoomEnvironment.js",
    "three/addons/loaders/GLTFLoader.js": f"{ADDONS}loaders/GLTFLoader.js",
    "three/addons/loaders/OBJLoader.js": f"{ADDONS}loaders/OBJLoader.js",
    "three/addons/loaders/PLYLoader.js": f"{ADDONS}loaders/PLYLoader.js",
    "three/addons/loaders/STLLoader.js": f"{ADDONS}loaders/STLLoader.js",
}
# Modules that those import by their place beside them.
BESIDE = (
    "three/build/three.core.js",
    f"{ADDONS}utils/BufferGeometryUtils.js",
    f"{ADDONS}utils/SkeletonUtils.js",
)
FOREVER = "public, max-age=31536000, immutable"
LINK = re.compile(rf'"({PREFIX}[\w./-]+)"')  # of the page to one of the files
MAP = '<script type="importmap"></script>'  # its place in the page
LATER = ("viewer.js", "models.js")  # of our modules those that need three.js, which come once the page stands


@dataclass(frozen=True)
class Site:
    """The page, the policy that it is sent with, and all other files by their paths."""

    page: StaticFile
    policy: str
    files: dict[str, StaticFile]


def sources(libraries: Path = LIBRARIES) -> dict[str, Path]:
    """Every file beside the page, by the path at which the page and the modules name it."""
    own = {PREFIX + path.relative_to(STATIC).as_posix(): path for path in STATIC.rglob("*.*") if path.suffix != ".html"}
    return own | {f"{PREFIX}lib/{name}": libraries / name for name in (*NAMED.values(), *BESIDE)}


@cache
def site(libraries: Path = LIBRARIES) -> Site:
    """All files, read and compressed once.

    A module keeps importing others by their plain paths: the page's import map leads these to the names with hashes.

    Raises:
        FileNotFoundError: a library is not installed.
    """
    files, hashed = {}, {}
    for name, path in sorted(sources(libraries).items()):
        content = path.read_bytes()
        hashed[name] = f"{name.removesuffix(path.suffix)}.{sha256(content).hexdigest()[:12]}{path.suffix}"
        files[hashed[name]] = as_sent(content, path.suffix, FOREVER)
    imports = {name: url for name, url in hashed.items() if name.endswith(("js", "mjs"))}
    imports |= {name: hashed[f"{PREFIX}lib/{path}"] for name, path in NAMED.items()}
    import_map = json.dumps({"imports": imports})
    page = LINK.sub(lambda link: f'"{hashed[link[1]]}"', (STATIC / "index.html").read_text())
    at_once = [url for name, url in imports.items() if name.startswith(PREFIX) and not name.endswith(LATER)]
    preloads = [f'<link rel="modulepreload" href="{url}">' for url in at_once if "/three/" not in url]
    page = page.replace(MAP, "\n".join([MAP.replace("><", f">{import_map}<"), *preloads]))
    # Models and pictures that a user opens, and the textures in them, are blobs.
    policy = (
        "default-src 'none'; "
        f"script-src 'self' 'sha256-{b64encode(sha256(import_map.encode()).digest()).decode()}'; "
        "style-src 'self'; img-src 'self' blob:; connect-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; "
        "form-action 'none'; require-trusted-types-for 'script'"
    )
    return Site(as_sent(page.encode(), ".html"), policy, files)


def allowing(policy: str, link: str | None) -> str:
    """Policy of the page where results are fetched from the host of a ``link``: from a bucket, by presigned links."""
    if link is None:
        return policy
    parts = urlsplit(link)
    return re.sub("(connect-src|img-src) 'self'", rf"\g<0> {parts.scheme}://{parts.netloc}", policy)


def require_console(settings: Settings) -> None:
    """Read the console's files, where it is to be served.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where a library is not installed.
    """
    if not settings.console:
        return
    try:
        site()
    except FileNotFoundError as error:
        print(
            f"The console's libraries are not installed: there is no {error.filename}. Run `make install`, or set "
            "MESHMARK_CONSOLE=off to go without the console.",
            file=sys.stderr,
        )
        sys.exit(2)
