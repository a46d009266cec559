"""Options of the command line for the setting of the text, and for labels."""

import argparse
import json
from pathlib import Path
from typing import Any

from core.labels.profiles import Label
from core.parameters import Align, Direction, LogoPosition, Profile, Strength, Wrap


def add_text_options(command: argparse.ArgumentParser) -> None:
    """Add the text, how it is set and rises, and what may stand beside it."""
    command.add_argument("--text", default="", type=_with_line_feeds, help=r"what to emboss; \n begins a line")
    command.add_argument("--wrap", choices=[wrap.value for wrap in Wrap], default=Wrap.AUTO.value, help=r"without \n")
    command.add_argument("--align", choices=[align.value for align in Align], default=Align.CENTER.value)
    command.add_argument("--line-spacing", type=float, default=1.2, metavar="EMS", help="from line to line (1.2)")
    command.add_argument("--letter-spacing", type=float, default=0.0, metavar="EMS", help="added between letters (0)")
    command.add_argument(
        "--direction",
        choices=[direction.value for direction in Direction],
        default=Direction.HORIZONTAL.value,
        help="of the lines; vertical is for Chinese, Japanese and Korean",
    )
    command.add_argument(
        "--profile",
        choices=[profile.value for profile in Profile],
        help="letters that rise smoothly, or with level tops and edges (default: the preset's)",
    )
    command.add_argument(
        "--strength",
        choices=[strength.value for strength in Strength],
        default=Strength.STANDARD.value,
        help="size and number of the marks: few small ones to large ones (default %(default)s)",
    )
    command.add_argument("--size", type=float, metavar="W", help="greatest text width; the asset's largest side is 30")
    command.add_argument("--size-exact", action="store_true", default=None, help="all marks as wide as --size")
    command.add_argument("--logo", type=Path, help="an SVG file, alone or beside the text")
    command.add_argument("--qr", metavar="URL", help="a QR code in place of a logo")
    command.add_argument(
        "--logo-position",
        choices=[position.value for position in LogoPosition],
        default=LogoPosition.LEFT.value,
        help="of logo or QR code by the text (default %(default)s)",
    )
    command.add_argument("--language", metavar="TAG", help="zh-Hans, zh-Hant, ja, ko, ...; default: guessed")


def add_label_options(command: argparse.ArgumentParser) -> None:
    """Add the machine-readable label."""
    command.add_argument(
        "--label", choices=[label.value for label in Label], help="write a machine-readable label, by a place's rules"
    )
    command.add_argument("--declaration", type=_json_file, metavar="D.json", help="statements about the model for it")
    command.add_argument("--metadata-only", action="store_true", help="write the label, and no mark")


def _json_file(path: str) -> Any:
    try:
        return json.loads(Path(path).read_bytes())
    except (OSError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{path} cannot be read as JSON ({error})") from None


def _with_line_feeds(text: str) -> str:
    return text.replace(r"\n", "\n")
