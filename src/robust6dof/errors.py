"""What goes wrong, said to the user in one line: what is wrong and what to do about it."""

from __future__ import annotations

from pathlib import Path


class Robust6dofError(Exception):
    """Base of every error that a user can mend; the command line prints it in one line."""


class Robust6dofWarning(UserWarning):
    """Something was repaired or ignored; the result stands, but the user should know."""


class InputError(Robust6dofError):
    """A value handed to the library is unusable (a wrong shape, unit, NaN, an empty mask)."""


class DataError(Robust6dofError):
    """A file or folder is unusable.

    Args:
        path: the file or folder at fault.
        problem: what is wrong with it.
        remedy: what the user can do.
    """

    def __init__(self, path: str | Path, problem: str, remedy: str) -> None:
        self.path = Path(path)
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{path}: {problem}. {remedy}")

    def __reduce__(self) -> tuple[type[DataError], tuple[Path, str, str]]:
        return type(self), (self.path, self.problem, self.remedy)


class MissingExtraError(Robust6dofError):
    """An optional dependency is not installed.

    Args:
        package: the module that could not be imported.
        extra: the extra of robust6dof that brings it.
    """

    def __init__(self, package: str, extra: str) -> None:
        self.package = package
        self.extra = extra
        super().__init__(f"{package} is not installed. Run: pip install 'robust6dof[{extra}]'")

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        return type(self), (self.package, self.extra)
