"""The command `gearcase`: the verbs of `app.commands`, each imported when it is called."""

import json
import sys
import traceback
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from app.commands import DATA_DIR, DONE, FAILURE, STOPPED

COMMANDS: tuple[tuple[str, str, str], ...] = (
    ("serve", "app.commands.serve", "Serve the API and the pages."),
    ("worker", "app.commands.jobs", "Run jobs; start as many workers as you like."),
    ("keys", "app.commands.keys", "Make, list and revoke keys."),
    ("diagnose", "app.commands.diagnose", "Diagnose recordings against the local library."),
    ("retrieve", "app.commands.diagnose", "Find the nearest cases of a recording; nothing is stored."),
    ("watch", "app.commands.record", "Send each new recording of a folder to a service."),
    ("record", "app.commands.record", "Record with a microphone, check it, send it."),
    ("smoke", "app.commands.smoke", "Check a service that runs: the main job, step by step."),
    ("size", "app.commands.sound", "Say how large backlash (play) or tooth damage (notch) is."),
    ("cases", "app.commands.cases", "Add, list, export and import cases."),
    ("axes", "app.commands.axes", "List, show, add and change axes."),
    ("recordings", "app.commands.cases", "Erase the audio of recordings."),
    ("generate", "app.commands.generate", "Generate cases by simulation."),
    ("fit", "app.commands.sound", "Fit the simulated sound to normal recordings of an axis."),
    ("compare", "app.commands.sound", "Say what the simulated sound of an axis gets wrong."),
    ("starter", "app.commands.generate", "Fill an empty library with cases of the paper's axis."),
    ("jobs", "app.commands.jobs", "List, follow, cancel, resume and adopt jobs."),
    ("simulate", "app.commands.simulate", "Simulate an axis: telemetry and sound."),
    ("investigate", "app.commands.investigate", "Say what the simulation of an axis gets wrong."),
    ("evaluate", "app.commands.cases", "Cross-validate the library over its gearboxes."),
    ("backup", "app.commands.installation", "Write everything into a folder, with checksums."),
    ("restore", "app.commands.installation", "Bring a backup back into an empty data directory."),
    ("doctor", "app.commands.installation", "Check this installation and say what to do."),
)
"""Verb, the module where a function or a group of commands has its name, one line of help."""


LEFT = {
    "diagnose": "the diagnoses made so far are in the library; the same command makes all of them again",
    "smoke": "what was sent to the service stays there",
    "cases": "cases added or imported so far stay, and the same command goes on; a bundle being exported is not whole",
    "recordings": "recordings erased so far stay erased; the same command goes on",
    "generate": "the cases made so far are in the library; the same command goes on with the others",
    "starter": "the cases made so far are in the library; the same command goes on with the others",
    "jobs": "the job goes on; `gearcase jobs follow` shows it again",
    "simulate": "files that were being written are not whole; the same command writes them again",
    "backup": "the folder holds no whole backup; remove it before you begin again",
    "restore": "the data folder is as it was; the same command begins again",
}
"""What is left of a verb that was stopped by Ctrl-C; nothing of those that are not named."""
DATA_DIR_OPTION, JSON = "--data-dir", "--json"
EPILOG = "Exit codes: 0 done, 1 failure, 2 usage or bad input, 3 fault found with --fail-on fault."


def main() -> None:
    """Run the command line of this process."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code; errors become a sentence on stderr, with --json a document as well.

    So does Ctrl-C.
    """
    arguments = json_last(data_dir_first(arguments))
    verb = verb_of(arguments)
    try:
        build(verb)(args=arguments, prog_name="gearcase", standalone_mode=True)
    except (SystemExit, KeyboardInterrupt) as end:
        code = end.code if isinstance(end, SystemExit) else STOPPED
        if code != STOPPED:
            return code if isinstance(code, int) else FAILURE
        words = f"stopped: {LEFT.get(verb or '', 'nothing was changed or kept')}"
        print(f"gearcase: {words}", file=sys.stderr)
    except Exception as error:  # noqa: BLE001 - whoever called gets an answer whatever happened
        from app.commands.faults import exit_code, sentence  # the table of errors is slow to import

        code = exit_code(error)
        if code is None:
            traceback.print_exc()
            words, code = f"{type(error).__name__}: {error}; this is a fault of the program, see stderr", FAILURE
        else:
            words = sentence(error)
            print(f"gearcase: {words}", file=sys.stderr)
    else:
        return DONE
    if JSON in arguments:
        print(json.dumps({"error": words, "exit_code": code}, ensure_ascii=False))
    return code


def data_dir_first(arguments: list[str]) -> list[str]:
    """Move `--data-dir DIR` to the front, so that it may stand before or after the verb."""
    front: list[str] = []
    rest: list[str] = []
    words = iter(arguments)
    for word in words:
        if word == "--":
            rest += [word, *words]
        elif word == DATA_DIR_OPTION:
            front = [word, *([value] if (value := next(words, None)) is not None else [])]
        elif word.startswith(DATA_DIR_OPTION + "="):
            front = [word]
        else:
            rest.append(word)
    return front + rest


def json_last(arguments: list[str]) -> list[str]:
    """Move `--json` to the end, where the verb reads it, so that it may stand before the verb."""
    words = arguments[: arguments.index("--")] if "--" in arguments else arguments
    rest = [word for word in words if word != JSON]
    return [*rest, *[JSON] * (len(rest) < len(words)), *arguments[len(words) :]]


def verb_of(arguments: list[str]) -> str | None:
    """Return the first word that is no global option."""
    skip = 2 if arguments[:1] == [DATA_DIR_OPTION] else 0
    return next((word for word in arguments[skip:] if not word.startswith("-")), None)


def build(verb: str | None) -> typer.Typer:
    """Return the command line with this verb in full and the others by name and help alone."""
    app = typer.Typer(
        help="Diagnosis of robot gearboxes from their sound, by known cases and by simulation.",
        epilog=EPILOG,
        no_args_is_help=True,
        add_completion=False,
        rich_markup_mode=None,  # it would take units in brackets for styles
        pretty_exceptions_enable=False,
    )
    app.callback()(options)
    for name, module, words in COMMANDS:
        if name != verb:
            app.command(name, help=words)(_elsewhere)
            continue
        found = getattr(import_module(module), name)
        if isinstance(found, typer.Typer):
            app.add_typer(found, name=name)
        else:
            app.command(name)(found)
    return app


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(version("gearcase"))
        raise typer.Exit


def options(
    data_dir: Annotated[
        Path | None,
        typer.Option(
            envvar="GEARCASE_DATA_DIR", help="folder with the data of this installation [.gearcase]", show_default=False
        ),
    ] = None,
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and end")
    ] = False,
) -> None:
    DATA_DIR.set(data_dir)


def _elsewhere() -> None:
    """Stands for a verb that was not called."""
