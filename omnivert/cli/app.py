"""All commands under one name, and what happens when one of them refuses."""

import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated

import typer

import omnivert
from omnivert.cli import say
from omnivert.cli.bench import app as bench
from omnivert.cli.explain import command as explain
from omnivert.cli.interrupts import INTERRUPTED, TERMINATED, interruptible
from omnivert.cli.offline import calibrate, montecarlo, simulate, track
from omnivert.cli.recordings import import_, play, rec, record
from omnivert.cli.robot import demo, doctor, drive, extrinsics, monitor, setup, show_config, up
from omnivert.errors import DataError, OmnivertError, UseError

app = typer.Typer(
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
app.command("demo")(demo.demo)
app.command("up")(up.up)
app.command("monitor")(monitor.monitor)
app.command("drive")(drive.drive)
app.command("record")(record.record)
app.command("play")(play.play)
app.add_typer(rec.app, name="rec")
app.add_typer(import_.app, name="import")
app.add_typer(setup.app, name="setup")
app.command("calibrate")(calibrate.calibrate)
app.command("track")(track.track)
app.command("doctor")(doctor.doctor)
app.add_typer(extrinsics.app, name="extrinsics")
app.add_typer(bench.app, name="bench")
app.command("simulate")(simulate.simulate)
app.command("montecarlo")(montecarlo.montecarlo)
app.command("config")(show_config.config)
app.command("explain")(explain.explain)

WRONG_USE: type[Exception] = typer.BadParameter.__bases__[0]  # every error of the command line itself


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    """Where does the camera really sit on the robot, and how sure is that?

    Begin with: omnivert demo
    """
    if version:
        say.result(f"omnivert {omnivert.__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        say.result(context.get_help())


def main() -> None:
    """The console script."""
    say.streams_in_place()
    code = INTERRUPTED
    came: list[int] = []
    # A KeyboardInterrupt that comes as far as here came between two lines of ours.
    try:
        with suppress(KeyboardInterrupt), interruptible(came):
            code = run(sys.argv[1:])
    except Exception:
        if not came:  # else a library has made another error of the interruption: pydantic does
            raise
    sys.exit(TERMINATED if code == INTERRUPTED and signal.SIGTERM in came else code)


def run(arguments: Sequence[str]) -> int:
    """Run one command line.

    returns  its exit code: 0 done, 1 the data do not allow it, 2 wrong use; 130 interrupted, 141 nobody reads on
    """
    try:
        return _ran(arguments)
    except BrokenPipeError:
        return _nobody_reads()
    except SystemExit as error:  # how rich and typer end a program that nobody reads on
        if not isinstance(error.__context__, BrokenPipeError):
            raise
        return _nobody_reads()


def _nobody_reads() -> int:
    """As of a program that SIGPIPE has ended; what is still held back to be written goes nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())
    return 128 + signal.SIGPIPE


def _ran(arguments: Sequence[str]) -> int:
    try:
        code = app(args=list(arguments), prog_name="omnivert", standalone_mode=False)
        sys.stdout.flush()
    except OmnivertError as error:
        return _refused(error, arguments)
    except WRONG_USE as error:
        return _refused(_use_error(error), arguments)
    except BrokenPipeError:
        raise
    except OSError as error:  # whatever path or stream it was that a command did not expect to fail
        return _refused(_broken_world(error), arguments)
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    return code if isinstance(code, int) else 0


def _refused(error: OmnivertError, arguments: Sequence[str]) -> int:
    if "--json" in arguments:
        say.json_result({"error": say.refusal_json(error)})
    say.refuse(error)
    return error.exit_code


def _broken_world(error: OSError) -> DataError:
    place = f" {error.filename}" if error.filename is not None else ""
    return DataError("OV210", f"the system refuses{place}", error.strerror or str(error), "omnivert explain OV210")


def _use_error(error: Exception) -> UseError:
    """An error of the command line in the form of all others, with the nearest right word."""
    words = getattr(error, "possibilities", None)
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "omnivert"
    if words:
        option = getattr(error, "option_name", "")
        return UseError("OV205", f"{command}: no option {option}", help=f"did you mean {' or '.join(words)}?")
    text = str(error.format_message() if hasattr(error, "format_message") else error).strip().rstrip(".")
    what, _, hint = text.partition(". Did you mean ")
    what = what[0].lower() + what[1:]
    if hint:
        near = hint.rstrip("?").replace("'", "")
        return UseError("OV205", f"{command}: {what}", help=f"did you mean {near}?")
    return UseError("OV205", f"{command}: {what}", help=f"{command} --help")
