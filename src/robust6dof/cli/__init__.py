"""One command, `robust6dof`, with a lazily imported file for each subcommand.

A subcommand's module has a frozen dataclass `Options(CommonOptions)`, whose field docstrings are
its help, and `run(options)`. Both import nothing heavy at module level, so that `--help` is
immediate.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

from robust6dof.network.freed_memory import keep_freed_memory

COMMANDS: dict[str, str] = {
    "demo": "the main job in one go: track an object and guide the aerial manipulator to it",
    "track": "follow an object through an RGB-D recording",
    "synthesize": "make synthetic recordings with ground truth",
    "synthesize ycb-video": "render YCB-Video's real trajectories with scanned shapes",
    "train": "train the tracker's network on the synthetic world or on recordings",
    "train-segmenter": "fine-tune Mask R-CNN on the synthetic world and export it to ONNX",
    "bench": "measure speed: the network alone, or the tracker from image to pose",
    "bench start": "measure how often a tracker starts rightly, by category and kind of hint",
    "predict": "run a tracker over a data set and store its poses",
    "evaluate": "score stored poses under a named protocol",
    "experiment": "make a table and figure of the paper on the data at hand",
    "guide": "guide the simulated aerial manipulator to an object",
    "doctor": "say what a folder of data is and whether it makes sense",
    "priors": "build a category's shape prior from procedural objects or your own meshes",
}
"""Name of each subcommand (its module has the same name, with _ for - and space) and its one-line
help."""

READER_GONE = 141
"""Exit code when whatever reads the output has closed it (`| head`): 128 + SIGPIPE, a shell's."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code (0 only on success)."""
    keep_freed_memory()
    try:
        try:
            return _dispatch(list(sys.argv[1:] if argv is None else argv))
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        _discard_output()
        return READER_GONE


def _discard_output() -> None:
    """Nobody reads it; else the interpreter would complain when it flushes at its end."""
    with open(os.devnull, "w") as nothing:
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nothing.fileno(), stream.fileno())


def _dispatch(args: list[str]) -> int:
    if not args or args[0] in ("-h", "--help"):
        print(_usage())
        return 0 if args else 2
    if args[0] == "--version":
        from robust6dof import __version__

        print(f"robust6dof {__version__}")
        return 0
    words = 2 if " ".join(args[:2]) in COMMANDS else 1
    name, rest = " ".join(args[:words]), args[words:]
    if name not in COMMANDS:
        print(f"robust6dof: no command '{name}'; there is: {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    return _run_command(name, rest)


def _run_command(name: str, args: list[str]) -> int:
    import tyro

    from robust6dof.errors import Robust6dofError

    module = importlib.import_module(f"robust6dof.cli.{name.replace('-', '_').replace(' ', '_')}")
    options = tyro.cli(
        module.Options,
        prog=f"robust6dof {name}",
        description=module.__doc__,
        args=args,
    )
    try:
        module.run(options)
    except Robust6dofError as error:
        if options.debug:
            raise
        print(f"robust6dof {name}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"robust6dof {name}: interrupted; what was done is kept", file=sys.stderr)
        return 130
    except BrokenPipeError:
        raise
    except Exception as error:
        if options.debug:
            raise
        print(
            f"robust6dof {name}: unexpected {type(error).__name__}: {error} "
            "(run again with --debug for the traceback)",
            file=sys.stderr,
        )
        return 1
    return 0


def _usage() -> str:
    width = max(map(len, COMMANDS))
    rows = [f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()]
    return "\n".join(
        [
            "usage: robust6dof COMMAND [options]     (robust6dof COMMAND --help for one command)",
            "       robust6dof --version",
            "",
            *rows,
        ]
    )
