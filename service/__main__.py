"""`python -m service [all|api|openapi|keys|jobs|credentials|adopt-store]`: API with workers, API alone, and tools.

`python -m service --show-settings` prints every setting with its value and where that comes from.
"""

import argparse
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence

import structlog
import yaml
from sqlalchemy.exc import OperationalError

from service.app import create_app
from service.background import in_background
from service.config import Settings, load_settings
from service.console.site import require_console
from service.credentials import add_credentials_commands, require_chain, require_trust, run_credentials_command
from service.data_folder import keep_private
from service.dead_jobs import add_jobs_commands, run_jobs_command
from service.hangup import hangup_handler
from service.http_server import Server
from service.jobs.ledger import UnusableLedgerError
from service.keys import add_keys_commands, run_keys_command
from service.logs import configure_logs
from service.show_settings import show_settings
from service.stores import no_database, require_own_store, require_secrets, run_adopt_store
from service.tracing import configure_tracing

RESTART_DELAY = 1.0  # seconds between a worker's death and its restart, so that one that cannot start is no busy loop
STOP_MARGIN = 5.0  # seconds beyond the graceful shutdown of a worker after which it is killed

log = structlog.get_logger("service")


class Supervisor:
    """Keeps one process running: restarts it after it died, until told to stop."""

    def __init__(self, command: Sequence[str], stop_timeout: float) -> None:
        self._command, self._stop_timeout = command, stop_timeout
        self._stopping = threading.Event()

    def start(self) -> None:
        """Start the process and watch it."""
        self._thread = in_background("supervisor", self._run)

    def stop(self) -> None:
        """Request the end of the process: SIGTERM, then SIGKILL after the stop timeout."""
        self._stopping.set()

    def join(self) -> None:
        """Wait until the process is gone."""
        self._thread.join()

    def _run(self) -> None:
        while not self._stopping.is_set():
            # A session of its own: Ctrl-C reaches this process only, and this process ends the worker.
            process = subprocess.Popen(self._command, start_new_session=True)
            while process.poll() is None and not self._stopping.wait(0.2):
                pass
            if self._stopping.is_set():
                self._end(process)
            else:
                log.error("the worker died and is started again", exit_code=process.returncode)
                self._stopping.wait(RESTART_DELAY)

    def _end(self, process: "subprocess.Popen[bytes]") -> None:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        try:
            process.wait(self._stop_timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def serve(settings: Settings, *workers: Sequence[str]) -> None:
    """Run the API, and beside it workers started by these commands, until SIGINT, SIGTERM or SIGHUP."""
    keep_private(settings)
    configure_logs(settings.log_level)
    configure_tracing("meshmark-api")
    require_own_store(settings)
    require_secrets(settings)
    require_console(settings)
    app = create_app(settings)
    supervisors = [Supervisor(command, settings.shutdown_seconds + STOP_MARGIN) for command in workers]
    for supervisor in supervisors:
        supervisor.start()
    for number in (signal.SIGINT, signal.SIGTERM):  # uvicorn raises the signal again once it has shut down
        signal.signal(number, lambda *_: sys.exit(0))
    signal.signal(signal.SIGHUP, hangup_handler())
    try:
        Server(app, settings).run()
    finally:
        for supervisor in supervisors:  # all at once: each may take its time
            supervisor.stop()
        for supervisor in supervisors:
            supervisor.join()


def openapi() -> str:
    """The OpenAPI document as YAML."""
    return yaml.safe_dump(create_app(Settings()).openapi(), sort_keys=False, allow_unicode=True, width=120)


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    top = argparse.ArgumentParser(prog="python -m service", description=__doc__)
    top.add_argument("--show-settings", action="store_true", help="print the settings in effect and end")
    commands = top.add_subparsers(dest="what", metavar="all|api|openapi|keys|jobs|credentials|adopt-store")
    for name, meaning in (("all", "API and workers"), ("api", "the API alone"), ("openapi", "print its document")):
        commands.add_parser(name, help=meaning)
    add_keys_commands(commands.add_parser("keys", help="create, list and revoke API keys"))
    add_jobs_commands(commands.add_parser("jobs", help="list jobs whose workers died, and try them again"))
    add_credentials_commands(commands.add_parser("credentials", help="make a key and a chain for tests"))
    commands.add_parser("adopt-store", help="make another database's artifact store this one's")
    return top


def main() -> None:
    """Run the command."""
    arguments = parser().parse_args()
    if arguments.show_settings:
        rows = show_settings(load_settings())
        widths = [max(map(len, column)) for column in list(zip(*rows, strict=True))[:2]]
        for variable, value, origin in rows:
            print(f"{variable:{widths[0]}}  {value:{widths[1]}}  {origin}")
        return
    try:
        run(arguments)
    except (OperationalError, UnusableLedgerError) as error:
        print(no_database(error) if isinstance(error, OperationalError) else error, file=sys.stderr)
        sys.exit(2)


def run(arguments: argparse.Namespace) -> None:
    """Dispatch the command line to its command."""
    match arguments.what:
        case "openapi":
            sys.stdout.write(openapi())
        case "keys":
            sys.exit(run_keys_command(_private_settings(), arguments))
        case "jobs":
            sys.exit(run_jobs_command(_private_settings(), arguments))
        case "credentials":
            sys.exit(run_credentials_command(arguments))
        case "adopt-store":
            sys.exit(run_adopt_store(_private_settings()))
        case "api":
            serve(load_settings())
        case _:
            settings = load_settings()
            require_trust(settings)
            modules = ["worker", "worker.webhooks"]
            if settings.c2pa_chain or settings.c2pa_key:
                require_chain(settings)  # here too: a signer that cannot start would be started again and again
                modules.append("worker.signer")
            serve(settings, *([sys.executable, "-m", module, str(os.getpid())] for module in modules))


def _private_settings() -> Settings:
    settings = load_settings()
    keep_private(settings)
    return settings


if __name__ == "__main__":
    main()
