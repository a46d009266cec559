"""The command `meshmark doctor`."""

import sys
from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import entry_points

from core import __version__
from core.cli.options import Json
from core.cli.progress import progress
from core.cli.status import Status
from core.cli.terminal import Item, say, say_json, say_list
from core.doctor import Finding, State, findings

GROUP = "meshmark.doctor"  # of entry points: packages above the engine add their findings
STYLES = {State.OK: "green", State.OPTIONAL: "yellow", State.MISSING: "bold red"}


def doctor(json: Json = False) -> Status:
    """Say what of all that Meshmark needs is on this machine, and what to do about the rest."""
    found = []
    with progress("doctor", quiet=json or not sys.stderr.isatty()) as tell:
        for each in _all_findings():
            found.append(each)
            if tell is not None:
                tell(each.part, None)
    missing = [each.part for each in found if each.state is State.MISSING]
    if json:
        say_json({"version": __version__, "missing": missing, "findings": [asdict(each) for each in found]})
    else:
        say_list([Item(each.state, STYLES[each.state], each.part, each.found, each.remedy) for each in found])
        if missing:
            say(f"Missing: {', '.join(missing)}.", style="bold red")
        else:
            say("All that is required is there.", style="green")
    return Status.UNAVAILABLE if missing else Status.DONE


def _all_findings() -> Iterator[Finding]:
    yield from findings()
    for entry in sorted(entry_points(group=GROUP)):
        yield from entry.load()()
