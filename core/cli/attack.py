"""The command `meshmark attack`."""

from pathlib import Path
from typing import Annotated

import typer

from core.cli.files import STANDARD, read_file, require_streams, write_file
from core.cli.options import ACCEPTED, Json, Quiet, Seed
from core.cli.progress import progress
from core.cli.terminal import say, say_json

# As in `core.lab.attacks.attack`, which loads the geometry libraries; a test compares them.
ATTACKS = (
    *("crop", "removal", "remesh", "decimate", "subdivide", "rotate", "translate", "scale", "noise", "smooth"),
    "reexport",
)
EPILOG = f"Attacks: {', '.join(ATTACKS)}. What a strength means is said when one is out of range."


def attack(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Which attack.", autocompletion=lambda: [*ATTACKS])],
    file: Annotated[Path, typer.Argument(metavar="IN", help=f"{ACCEPTED}.")],
    output: Annotated[Path, typer.Argument(metavar="OUT.glb", help="What is left; - for standard output.")],
    strength: Annotated[
        float | None, typer.Option(metavar="S", help="Default: as in the paper where it has one.")
    ] = None,
    original: Annotated[
        Path | None,
        typer.Option(metavar="ORIGINAL", help="The file without watermarks; removal needs it to find letters."),
    ] = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Damage a watermarked file as a thief would. Only plain geometry comes out."""
    require_streams([file, original], [output], as_json=json)
    data, before = read_file(file), read_file(original) if original else None
    with progress(str(file), quiet=quiet) as tell:
        if tell is not None:
            tell(name, None)
        from core.lab.attacks.attack import attack_file

        left = attack_file(data, name, strength, seed, before)
    write_file(output, left)
    if json:
        say_json({"output": str(output), "bytes": len(left)})
    elif not quiet and output != STANDARD:
        say(f"{output}: {len(left):,} bytes")
